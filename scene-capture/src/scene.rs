//! From photos or a video to a COLMAP scene on disk.

use crate::colmap::{Colmap, Evidence, FeatureJob, Mapped};
use crate::error::CaptureError;
use crate::masks;
use crate::matching::attempts;
use crate::merging::Merging;
use crate::models::Models;
use crate::photos::{Photo, PhotoSet};
use crate::source::Source;
use crate::upright;
use crate::video::{Ffmpeg, FrameOptions};
use crate::watch::{Progress, Stage, Watch};
use draft_folder::{Draft, Existing, Occupant};
use image::metadata::Orientation;
use io_colmap::PhotoHeader;
use rayon::prelude::*;
use std::ffi::OsStr;
use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};

/// The file in a captured scene that says what was decided; also the sign that a folder is one.
pub const RECORD: &str = "capture.txt";

/// What to make of photos or a video.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CaptureOptions {
    /// How many frames to take from a video.
    pub frames: FrameOptions,
    /// Masks by name of the photo, black where COLMAP must not look for features: things that
    /// moved, or the room around a turntable.
    pub masks: Option<PathBuf>,
    /// What to do if there is a scene already.
    pub existing: Existing,
}

/// The programs that do the work.
#[derive(Debug, Clone)]
pub struct Tools {
    /// Finds poses.
    pub colmap: Colmap,
    /// Reads videos; not needed for photos.
    pub ffmpeg: Option<Ffmpeg>,
}

impl Tools {
    /// Finds what the source needs on the PATH.
    ///
    /// # Errors
    /// [`CaptureError::Missing`] with how to install what is not there.
    pub fn find_for(source: &Source) -> Result<Self, CaptureError> {
        let ffmpeg = match source {
            Source::Video(_) => Some(Ffmpeg::find()?),
            Source::Photos(_) => None,
        };
        Ok(Self {
            colmap: Colmap::find()?,
            ffmpeg,
        })
    }
}

/// What was captured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Captured {
    /// Number of photos, or of frames taken.
    pub photos: usize,
    /// How many of them have poses, in the largest model.
    pub registered: usize,
    /// Photos with poses by model, the largest first, which is `sparse/0`.
    pub models: Vec<usize>,
    /// Decisions taken, as they were told to the [`Watch`].
    pub notes: Vec<String>,
    /// What to do better next time, where few photos have poses.
    pub warning: Option<String>,
}

/// Makes a scene folder: photos in `images/` (as hard links where the disk allows), models in
/// `sparse/0`, … and what was decided in `capture.txt`. The folder appears when it is complete.
///
/// # Errors
/// [`CaptureError`] if `out` is in the way, photos, video or masks cannot be used, a program fails,
/// no poses are found, or the watch says to stop.
pub fn capture(
    source: &Source,
    out: &Path,
    tools: &Tools,
    options: &CaptureOptions,
    watch: &dyn Watch,
) -> Result<Captured, CaptureError> {
    if let Some((what, remedy)) = in_the_way(out, options.existing) {
        return Err(CaptureError::bad(out, what, remedy));
    }
    if let (Source::Video(video), Some(_)) = (source, &options.masks) {
        return Err(CaptureError::bad(
            video,
            "masks are matched to photos by name, and frames of a video have none yet",
            "leave the masks out, or capture the frames first and mask those",
        ));
    }
    let draft = Draft::beside(out)?;
    let mut job = Job {
        source,
        folder: draft.path(),
        out,
        tools,
        options,
        watch,
        notes: Vec::new(),
        originals: None,
    };
    let captured = job.run().map_err(|error| job.outside(error))?;
    put(draft, out, options.existing)?;
    Ok(captured)
}

/// Puts the scene in its place. That was free, or what is in it was to be replaced; but COLMAP takes hours, in which
/// somebody else may have used it. Then the poses are kept beside it.
fn put(draft: Draft, out: &Path, existing: Existing) -> Result<(), CaptureError> {
    let own = draft.path().file_name();
    let is_own = |entry: io::Result<DirEntry>| entry.is_ok_and(|it| Some(&*it.file_name()) == own);
    // The draft may lie in its place.
    let is_free = fs::read_dir(out).is_ok_and(|mut entries| entries.all(is_own));
    let in_the_way = if is_free {
        None
    } else {
        in_the_way(out, existing)
    };
    let Some((what, _)) = in_the_way else {
        match existing {
            Existing::Keep => draft.finish()?,
            Existing::Replace => draft.replace()?,
        }
        return Ok(());
    };
    let name = out.file_name().unwrap_or(OsStr::new("scene"));
    let beside = |number| {
        let mut name = name.to_owned();
        name.push(format!("-{number}"));
        draft.path().with_file_name(name)
    };
    let free = (2_u32..).map(beside).find(|place| !place.exists());
    let kept = free.unwrap_or_else(|| draft.path().with_extension("kept"));
    let kept = if fs::rename(draft.path(), &kept).is_ok() {
        kept
    } else {
        let own = draft.path().to_owned();
        // Where it is, it would be removed.
        std::mem::forget(draft);
        own
    };
    Err(CaptureError::bad(
        out,
        format!("{what}; it came while poses were looked for"),
        format!(
            "the captured scene is {} instead: use or rename that",
            kept.display()
        ),
    ))
}

/// What is in a place where no scene can be put for it, and what to do.
fn in_the_way(out: &Path, existing: Existing) -> Option<(String, String)> {
    let elsewhere = "name a folder that is empty or does not exist";
    Some(match (Occupant::of(out), existing) {
        (Ok(None), _) => return None,
        (Ok(Some(_)), Existing::Replace) if out.join(RECORD).is_file() => return None,
        (Ok(Some(occupant)), Existing::Replace) => (
            format!(
                "there is something in it, {occupant}, and no captured scene, so it is not replaced"
            ),
            occupant.remedy(elsewhere),
        ),
        (Ok(Some(occupant)), Existing::Keep) => (
            format!("there is something in it already, {occupant}"),
            occupant.remedy(&format!(
                "{elsewhere}, or replace a captured scene with --force"
            )),
        ),
        (Err(_), _) if out.exists() => ("it is in the way".to_owned(), elsewhere.to_owned()),
        (Err(_), _) => return None,
    })
}

pub(crate) fn create(folder: &Path) -> Result<(), CaptureError> {
    fs::create_dir_all(folder).map_err(|e| CaptureError::io("create", folder, e))
}

/// One capture, in a folder that is not yet where it will be.
struct Job<'a> {
    source: &'a Source,
    folder: &'a Path,
    /// Where it will be.
    out: &'a Path,
    tools: &'a Tools,
    options: &'a CaptureOptions,
    watch: &'a dyn Watch,
    notes: Vec<String>,
    /// The folder of the photos that `images/` has copies of.
    originals: Option<PathBuf>,
}

impl Job<'_> {
    fn run(&mut self) -> Result<Captured, CaptureError> {
        let (images, work) = (self.folder.join("images"), self.folder.join("work"));
        create(&images)?;
        create(&work)?;
        let set = self.gather(&images)?;
        let photos = set.photos.len();
        let colmap = self.tools.colmap.logging_to(&work);
        let cameras = match set.by_camera().len() {
            1 => "one camera".to_owned(),
            n => format!("{n} cameras"),
        };
        self.say(format!(
            "COLMAP {} looks for the poses of {photos} photos by {cameras}",
            colmap.version()
        ));
        let database = work.join("database.db");
        self.find_features(&colmap, &set, &images, &database)?;
        let (models, sparse) = self.find_poses(&colmap, &set, &images, &database)?;
        models.check(self.source, photos)?;
        let (notes, warning) = models.sentences(self.source, photos);
        notes.into_iter().for_each(|note| self.say(note));

        let kept = self.folder.join("sparse");
        fs::rename(&sparse, &kept).map_err(|e| CaptureError::io("rename", &sparse, e))?;
        fs::remove_dir_all(&work).map_err(|e| CaptureError::io("remove", &work, e))?;
        // What a reader would refuse is refused now.
        io_colmap::Scene::open(self.folder)?;
        let record = self.folder.join(RECORD);
        let lines: Vec<&str> = self
            .notes
            .iter()
            .chain(&warning)
            .map(String::as_str)
            .collect();
        let text = format!(
            "captured from {}\n{}\n",
            self.source.path().display(),
            lines.join("\n")
        );
        fs::write(&record, text).map_err(|e| CaptureError::io("write", &record, e))?;
        Ok(Captured {
            photos,
            registered: models.registered(),
            models: models.sizes,
            notes: std::mem::take(&mut self.notes),
            warning,
        })
    }

    /// The same about files that last: the folder is gone before the error is read.
    fn outside(&self, error: CaptureError) -> CaptureError {
        error.outside(self.folder, self.out, self.originals.as_deref())
    }

    fn say(&mut self, note: String) {
        self.watch.note(&note);
        self.notes.push(note);
    }

    /// Photos into `images`.
    fn gather(&mut self, images: &Path) -> Result<PhotoSet, CaptureError> {
        let set = match self.source {
            Source::Photos(folder) => {
                let mut set = PhotoSet::find(folder)?;
                self.originals = Some(set.root.clone());
                let placed = set.photos.par_iter_mut().map(|photo| {
                    place(
                        &set.root.join(&photo.name),
                        &images.join(&photo.name),
                        photo,
                    )
                });
                let turned: Vec<bool> = placed.collect::<Result<_, _>>()?;
                let count = turned.iter().filter(|turned| **turned).count();
                if count > 0 {
                    let photos = set.photos.len();
                    set.notes.push(format!(
                        "of {photos} photos {count} are turned upright, as their EXIF says they are seen"
                    ));
                }
                set
            }
            Source::Video(video) => {
                let Some(ffmpeg) = &self.tools.ffmpeg else {
                    return Err(CaptureError::bad(
                        video,
                        "no program to read videos with was given",
                        "find one with Tools::find_for",
                    ));
                };
                let frames = &self.options.frames;
                let taken = ffmpeg.take_frames(video, images, frames, self.watch)?;
                taken.notes.into_iter().for_each(|note| self.say(note));
                PhotoSet::find(images)?
            }
        };
        set.notes.iter().for_each(|note| self.say(note.clone()));
        Ok(set)
    }

    fn find_features(
        &mut self,
        colmap: &Colmap,
        set: &PhotoSet,
        images: &Path,
        database: &Path,
    ) -> Result<(), CaptureError> {
        let work = self.folder.join("work");
        let masks = match &self.options.masks {
            Some(stated) => {
                let masks = work.join("masks");
                create(&masks)?;
                let notes = masks::write(stated, set, &masks)?;
                notes.into_iter().for_each(|note| self.say(note));
                Some(masks)
            }
            None => None,
        };
        let total = set.photos.len();
        let progress = |done| Progress {
            stage: Stage::Features,
            done,
            total,
        };
        self.watch.progress(progress(0));
        let options = colmap.options("feature_extractor")?;
        let (mut done, mut damaged) = (0, Vec::new());
        for group in set.by_camera() {
            let list = work.join("photos.txt");
            let names: Vec<&str> = group.iter().map(|photo| &*photo.name).collect();
            fs::write(&list, names.join("\n")).map_err(|e| CaptureError::io("write", &list, e))?;
            let job = FeatureJob {
                images,
                database,
                list: &list,
                photos: group.len(),
                masks: masks.as_deref(),
            };
            damaged.extend(colmap.features(&options, &job, (done, total), self.watch)?);
            done += group.len();
        }
        self.watch.progress(progress(total));
        if let Some((name, why)) = damaged.first() {
            let count = damaged.len();
            self.say(format!(
                "COLMAP does without {count} photos, such as {name}: {why}"
            ));
        }
        Ok(())
    }

    /// Compares photos and finds poses, with more comparisons if too few are found, and then with fewer matches. Returns
    /// the best models and their folder.
    fn find_poses(
        &mut self,
        colmap: &Colmap,
        set: &PhotoSet,
        images: &Path,
        database: &Path,
    ) -> Result<(Models, PathBuf), CaptureError> {
        let photos = set.photos.len();
        let mut best: Option<(Models, PathBuf)> = None;
        let compared = attempts(self.source, photos, set.has_positions()).into_iter();
        let tried = compared
            .map(|matchers| (matchers, Evidence::Usual))
            .chain([(Vec::new(), Evidence::Less)]);
        for (i, (matchers, evidence)) in tried.enumerate() {
            if let Some((models, _)) = &best {
                if models.are_enough(photos) {
                    break;
                }
                let found = models.registered();
                self.say(match evidence {
                    Evidence::Usual => format!(
                        "comparing neighbours gave poses for {found} of {photos} photos, so all pairs \
                         are compared"
                    ),
                    Evidence::Less => format!(
                        "COLMAP's own thresholds gave poses for {found} of {photos} photos, so poses by fewer \
                         matches are tried"
                    ),
                });
            }
            for matcher in matchers {
                colmap.compare(matcher, database, self.watch)?;
            }
            let sparse = self.folder.join("work").join(format!("sparse-{i}"));
            create(&sparse)?;
            let mut models =
                match colmap.poses(images, database, &sparse, evidence, photos, self.watch)? {
                    Mapped::Some => Models::sort(&sparse)?,
                    Mapped::None => Models { sizes: Vec::new() },
                };
            if models.registered() < photos {
                let merging = Merging {
                    colmap,
                    images,
                    database,
                    sparse: &sparse,
                    work: &self.folder.join("work").join(format!("merging-{i}")),
                    watch: self.watch,
                };
                match merging.merge(&models) {
                    Ok(Some(merged)) => {
                        self.say(merged.note);
                        models = merged.models;
                    }
                    Ok(None) => {}
                    // The models are as they were, and the largest is a scene all the same.
                    Err(error @ CaptureError::Failed { .. }) => {
                        let error = self.outside(error);
                        self.say(format!("models were not merged: {error}"));
                    }
                    Err(error) => return Err(error),
                }
            }
            self.watch.progress(Progress {
                stage: Stage::Poses,
                done: models.registered(),
                total: photos,
            });
            if best
                .as_ref()
                .is_none_or(|(so_far, _)| models.registered() > so_far.registered())
            {
                best = Some((models, sparse));
            }
        }
        best.ok_or_else(|| {
            // Unreachable: there is always something to try.
            CaptureError::bad(self.source.path(), "nothing was tried", "try again")
        })
    }
}

/// A hard link to a photo, or a copy where that cannot be; turned where its EXIF says so, and then `true` is returned.
/// The `photo` is described as it is in its new place.
fn place(from: &Path, to: &Path, photo: &mut Photo) -> Result<bool, CaptureError> {
    if let Some(folder) = to.parent() {
        create(folder)?;
    }
    // A link to a symbolic link would lead nowhere from its new place.
    let full = from
        .canonicalize()
        .map_err(|e| CaptureError::io("read", from, e))?;
    if photo.orientation != Orientation::NoTransforms && upright::write(&full, to)? {
        photo.size = PhotoHeader::read(to)?.stored;
        return Ok(true);
    }
    photo.orientation = Orientation::NoTransforms;
    if fs::hard_link(&full, to).is_err() {
        fs::copy(&full, to).map_err(|e| CaptureError::io("copy", from, e))?;
    }
    Ok(false)
}
