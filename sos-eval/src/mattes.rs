//! What the grey of a folder's pictures means: alpha, or the labels that some tools write instead of black and white.

use crate::EvalError;
use crate::iou::Overlap;
use crate::matching::Pictures;
use crate::picture::{Plane, brightest_of_bytes, read_alpha};
use std::path::Path;

/// The mattes or masks of one folder.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mattes<'a> {
    folder: &'a Path,
    /// They hold the labels 0 and 1.
    labels: bool,
}

impl<'a> Mattes<'a> {
    /// Looks into the pictures until one shows what all of them are: no label is brighter than 1.
    ///
    /// JPEG is left out, whose noise turns black into ones here and there, as are 16 bits, in which a matte may be that dark.
    pub(crate) fn of(folder: &'a Path, pictures: &Pictures) -> Result<Self, EvalError> {
        let mut labels = false;
        for path in pictures.values() {
            let is_png = path
                .extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
            let brightest = if is_png {
                brightest_of_bytes(path)?
            } else {
                None
            };
            match brightest {
                Some(0) => {}
                Some(1) => labels = true,
                _ => {
                    return Ok(Self {
                        folder,
                        labels: false,
                    });
                }
            }
        }
        Ok(Self { folder, labels })
    }

    /// Whether they hold the labels 0 and 1.
    pub(crate) fn are_labels(&self) -> bool {
        self.labels
    }

    /// Reads one of them.
    pub(crate) fn read(&self, path: &Path) -> Result<Plane, EvalError> {
        let mut matte = read_alpha(path)?;
        if self.labels {
            let white = |value: &mut f32| *value = (255.0 * *value).min(1.0);
            matte.values.iter_mut().for_each(white);
        }
        Ok(matte)
    }

    /// What a user should know about how they were read.
    pub(crate) fn note(&self) -> Option<String> {
        self.labels.then(|| {
            format!(
                "the masks in {} hold the labels 0 and 1, read as black and white",
                self.folder.display()
            )
        })
    }

    /// What to say if black is the object in them by the `overlaps` of all views with the truth.
    pub(crate) fn inversion<'b>(
        &self,
        overlaps: impl Iterator<Item = &'b Overlap>,
    ) -> Option<String> {
        let (mut views, mut plain, mut inverted) = (0.0, 0.0, 0.0);
        // Masks of one colour say nothing about what the colours mean.
        for overlap in overlaps.filter(|overlap| overlap.tells_apart()) {
            views += 1.0;
            plain += overlap.iou();
            inverted += overlap.inverted().iou();
        }
        (inverted > plain && inverted > 0.5 * views).then(|| {
            format!(
                "the masks in {} are more like the truth with black and white exchanged: if black is the object there, \
                 exchange them first, for they were scored as they are",
                self.folder.display()
            )
        })
    }
}
