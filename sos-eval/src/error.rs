//! What can be wrong with the input, each in one sentence that names the file and the remedy.

use std::path::{Path, PathBuf};

/// Why an evaluation could not be done.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// A folder does not exist or may not be listed.
    #[error("the folder {} cannot be read ({reason}): check the path", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A folder of mattes where a run's folder is wanted.
    #[error("{} is a folder of mattes, and a run's folder has them in alpha/: give the run's folder, or score a folder of mattes with sos compare or sos-eval", .path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A folder without a single picture.
    #[error("the folder {} holds no .png, .jpg or .jpeg picture: point to the folder with one picture per view", .path.display())]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A folder without a picture that is wanted, which may lie in a sub-folder that cannot be read.
    #[error("{} holds no {wanted}, and its sub-folder {} cannot be read ({reason}): check that you may access it", .path.display(), .closed.display())]
    ClosedFolder {
        /// The folder.
        path: PathBuf,
        /// What is not in it.
        wanted: String,
        /// The sub-folder.
        closed: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A picture that cannot be decoded.
    #[error("the picture {} cannot be read ({reason}): export it again as an 8- or 16-bit PNG or JPEG", .path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// A picture in colour where a matte is wanted.
    #[error("{} is in colour and has no alpha channel, so it is no matte: point to grey mattes or masks, or to pictures whose alpha they are", .path.display())]
    NoMatte {
        /// The file.
        path: PathBuf,
    },
    /// Two pictures of one view that differ in size.
    #[error(
        "{} is {}x{} but {} is {}x{}: export both at the same resolution",
        .path.display(), .size.0, .size.1, .truth.display(), .truth_size.0, .truth_size.1
    )]
    SizeMismatch {
        /// The picture under test.
        path: PathBuf,
        /// Its width and height in pixels.
        size: (usize, usize),
        /// The ground truth it was compared with.
        truth: PathBuf,
        /// Its width and height in pixels.
        truth_size: (usize, usize),
    },
    /// Two files that could both belong to one view.
    #[error("{} and {} could both belong to view {view:?}: {}", .first.display(), .second.display(), one_of(.first, .second))]
    Ambiguous {
        /// Name of the view.
        view: String,
        /// One candidate.
        first: PathBuf,
        /// The other candidate.
        second: PathBuf,
    },
    /// Two folders without one view in common.
    #[error("no picture in {} has the name or number of one in {}: name the files like the ground truth", .folder.display(), .truth.display())]
    NoMatch {
        /// The folder under test.
        folder: PathBuf,
        /// The folder of ground truth.
        truth: PathBuf,
    },
    /// A view of the truth of which there is no photo.
    #[error(
        "no photo belongs to the true matte of view {view:?}: give the folder with the photos of all views"
    )]
    NoPhoto {
        /// Name of the view.
        view: String,
    },
    /// A picture or folder that cannot be written.
    #[error("{} cannot be written ({reason}): {remedy}", .path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        reason: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A mesh file that cannot be read.
    #[error("the mesh {} cannot be read ({reason}): export it again as a PLY triangle mesh", .path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A mesh without surface, so that no distance to it exists.
    #[error("the {which} mesh has no triangle with an area: compare meshes that have a surface")]
    EmptyMesh {
        /// `"predicted"` or `"true"`.
        which: &'static str,
    },
}

impl From<draft_folder::DraftError> for EvalError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::Write {
            remedy: error.remedy(),
            reason: error.source.to_string(),
            path: error.path,
        }
    }
}

/// What to do with two files of which one is meant.
fn one_of(first: &Path, second: &Path) -> String {
    match (first.parent(), second.parent()) {
        (Some(a), Some(b)) if a != b => format!(
            "name the folder that is meant, {} or {}",
            a.display(),
            b.display()
        ),
        _ => "rename or remove one of them".to_owned(),
    }
}
