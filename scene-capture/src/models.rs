//! What COLMAP made of the photos: how many have poses, in how many models.

use crate::colmap::model_folders;
use crate::error::CaptureError;
use crate::matching::ENOUGH;
use crate::source::Source;
use io_colmap::Model;
use std::fs;
use std::path::Path;

/// Fewer photos with poses are no scene.
const FEWEST_POSES: usize = 3;

/// The models of one run of the mapper.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Models {
    /// Photos with poses, by model, the largest first.
    pub(crate) sizes: Vec<usize>,
}

impl Models {
    /// Reads what the mapper wrote into `out`, and gives the largest model the number 0, which is
    /// the one that most tools take.
    pub(crate) fn sort(out: &Path) -> Result<Models, CaptureError> {
        let mut found = Vec::new();
        for folder in model_folders(out)? {
            let model = Model::read(&folder)?;
            // Paths on this machine that nobody needs.
            let _ = fs::remove_file(folder.join("project.ini"));
            found.push((model.views.len(), folder));
        }
        // Stable: of equal ones, the first that was found stays first.
        found.sort_by_key(|(views, _)| std::cmp::Reverse(*views));
        let rename = |from: &Path, to: &Path| {
            fs::rename(from, to).map_err(|e| CaptureError::io("rename", from, e))
        };
        let aside = |i: usize| out.join(format!("sorted-{i}"));
        for (i, (_, folder)) in found.iter().enumerate() {
            rename(folder, &aside(i))?;
        }
        for i in 0..found.len() {
            rename(&aside(i), &out.join(i.to_string()))?;
        }
        Ok(Models {
            sizes: found.into_iter().map(|(views, _)| views).collect(),
        })
    }

    /// Photos with poses in the largest model.
    pub(crate) fn registered(&self) -> usize {
        self.sizes.first().copied().unwrap_or_default()
    }

    pub(crate) fn are_enough(&self, photos: usize) -> bool {
        self.registered() as f64 >= ENOUGH * photos as f64
    }

    /// An error where there is no scene.
    pub(crate) fn check(&self, source: &Source, photos: usize) -> Result<(), CaptureError> {
        if self.registered() >= FEWEST_POSES {
            return Ok(());
        }
        let what = match self.registered() {
            0 => format!("COLMAP found no poses for its {photos} photos"),
            n => format!("COLMAP found poses for only {n} of its {photos} photos"),
        };
        Err(CaptureError::bad(source.path(), what, remedy(source)))
    }

    /// What a user should know about the result; a warning where it is poor.
    pub(crate) fn sentences(
        &self,
        source: &Source,
        photos: usize,
    ) -> (Vec<String>, Option<String>) {
        let registered = self.registered();
        let mut notes = vec![format!("{registered} of {photos} photos have poses")];
        if let [_, others @ ..] = &*self.sizes
            && !others.is_empty()
            // COLMAP may keep a first attempt beside a model of all photos.
            && registered < photos
        {
            let others: Vec<String> = others.iter().map(ToString::to_string).collect();
            notes.push(format!(
                "the photos fell apart into {} models; sparse/0 is the largest, \
                 the others have {} photos",
                self.sizes.len(),
                others.join(", ")
            ));
        }
        let warning = (!self.are_enough(photos)).then(|| {
            format!(
                "only {registered} of {photos} photos have poses; for more, {}",
                remedy(source)
            )
        });
        (notes, warning)
    }
}

fn remedy(source: &Source) -> &'static str {
    match source {
        Source::Photos(_) => {
            "take more photos that overlap by two thirds with their neighbours, keep textured \
             things in view, do not zoom or move anything, and leave blurred photos out"
        }
        Source::Video(_) => {
            "film more slowly and all around in good light, keep textured things in view, do not \
             zoom or turn on the spot, or take more frames with sos capture --frames"
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use io_colmap::{Camera, CameraModel, Pose, View};

    fn model(views: u32) -> Model {
        let mut model = Model::default();
        let camera = Camera {
            id: 1,
            model: CameraModel::SimplePinhole,
            width: 8,
            height: 8,
            params: vec![8.0, 4.0, 4.0],
        };
        model.cameras.insert(1, camera);
        model.views = (1..=views)
            .map(|id| View {
                id,
                name: format!("{id:03}.png"),
                camera_id: 1,
                camera_from_world: Pose::IDENTITY,
            })
            .collect();
        model
    }

    #[test]
    fn the_largest_model_becomes_the_first() {
        let dir = tempfile::tempdir().unwrap();
        for (name, views) in [("0", 4), ("1", 9), ("10", 4)] {
            model(views).write_binary(&dir.path().join(name)).unwrap();
            fs::write(dir.path().join(name).join("project.ini"), "").unwrap();
        }
        fs::create_dir(dir.path().join("empty")).unwrap();
        let models = Models::sort(dir.path()).unwrap();
        assert_eq!(models.sizes, [9, 4, 4]);
        let first = dir.path().join("0");
        assert_eq!(Model::read(&first).unwrap().views.len(), 9);
        assert!(!first.join("project.ini").exists());
        assert!(dir.path().join("2/images.bin").is_file());

        let photos = Source::Photos("p".into());
        let (notes, warning) = models.sentences(&photos, 15);
        assert_eq!(notes[0], "9 of 15 photos have poses");
        assert!(notes[1].contains("3 models"), "{notes:?}");
        assert!(
            notes[1].ends_with("the others have 4, 4 photos"),
            "{notes:?}"
        );
        assert_eq!(warning, None, "60 % are enough");
        let (_, warning) = models.sentences(&photos, 16);
        assert!(
            warning
                .unwrap()
                .contains("9 of 16 photos have poses; for more, take more")
        );
    }

    #[test]
    fn no_poses_are_an_error_with_a_remedy() {
        let video = Source::Video("v.mp4".into());
        let said = |sizes: &[usize]| {
            Models {
                sizes: sizes.to_vec(),
            }
            .check(&video, 30)
            .map_err(|e| e.to_string())
        };
        assert_eq!(said(&[3]), Ok(()));
        assert!(
            said(&[])
                .unwrap_err()
                .starts_with("v.mp4: COLMAP found no poses for its 30 photos; film")
        );
        assert!(said(&[2, 2]).unwrap_err().contains("only 2 of its 30"));
    }
}
