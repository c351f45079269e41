//! What the grey of a folder's pictures means: alpha, or the numbers that some tools write instead of black and white.

use crate::EvalError;
use crate::iou::Overlap;
use crate::matching::Pictures;
use crate::picture::{Grey, Plane, open};
use std::path::Path;

/// How a folder's numbers become alpha: alike in all of its files, as where masks are read to train from them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reading {
    /// 1 is the largest number that a file has room for.
    Full,
    /// 1 is 255, also in files of 16 bits: some tools store masks of 8 in them without rescaling.
    Bytes,
    /// 1 is 1.
    Labels,
}

impl Reading {
    /// A picture's alpha.
    pub(crate) fn read(self, path: &Path) -> Result<Plane, EvalError> {
        let picture = open(path)?;
        let white = match (self, Grey::is_wide(&picture)) {
            (Self::Full, _) | (Self::Bytes, false) => 1.0,
            (Self::Bytes, true) => 65535.0 / 255.0,
            (Self::Labels, false) => 255.0,
            (Self::Labels, true) => 65535.0,
        };
        let mut matte = Plane::alpha_of(picture, path)?;
        if white > 1.0 {
            let scale = |value: &mut f32| *value = (white * *value).min(1.0);
            matte.values.iter_mut().for_each(scale);
        }
        Ok(matte)
    }
}

/// The mattes or masks of one folder.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mattes<'a> {
    folder: &'a Path,
    reading: Reading,
}

impl<'a> Mattes<'a> {
    /// Looks into the pictures until one shows what all of them are.
    pub(crate) fn of(folder: &'a Path, pictures: &Pictures) -> Result<Self, EvalError> {
        let mattes = |reading| Self { folder, reading };
        // A run's own mattes have 16 bits, and are that dark where nothing of the object is left.
        if folder.ends_with("alpha") && folder.with_file_name("config.toml").is_file() {
            return Ok(mattes(Reading::Full));
        }
        // JPEG's noise turns black into ones here and there.
        let is_png = |path: &Path| {
            let ending = path.extension();
            ending.is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        };
        let may_be_labels = pictures.values().all(|path| is_png(path));
        let (mut largest, mut largest_wide) = (0, None);
        for path in pictures.values() {
            match Grey::range(&open(path)?) {
                Some(
                    Grey {
                        largest: 2..,
                        wide: false,
                    }
                    | Grey {
                        largest: 256..,
                        wide: true,
                    },
                )
                | None => {
                    return Ok(mattes(Reading::Full));
                }
                Some(grey) => {
                    largest = largest.max(grey.largest);
                    if grey.wide {
                        largest_wide = largest_wide.max(Some(grey.largest));
                    }
                }
            }
        }
        Ok(mattes(if may_be_labels && largest == 1 {
            Reading::Labels
        } else if largest_wide > Some(1) {
            Reading::Bytes
        } else {
            Reading::Full
        }))
    }

    /// How they are read.
    pub(crate) fn reading(&self) -> Reading {
        self.reading
    }

    /// Reads one of them.
    pub(crate) fn read(&self, path: &Path) -> Result<Plane, EvalError> {
        self.reading.read(path)
    }

    /// What a user should know about how they were read.
    pub(crate) fn note(&self) -> Option<String> {
        let folder = self.folder.display();
        match self.reading {
            Reading::Full => None,
            Reading::Bytes => Some(format!(
                "the masks in {folder} have 16 bits but nothing above 255, read as white"
            )),
            Reading::Labels => Some(format!(
                "the masks in {folder} hold the labels 0 and 1, read as black and white"
            )),
        }
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
