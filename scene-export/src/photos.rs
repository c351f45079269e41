//! The scene's photos beside what is exported: copied where that will do, else written anew.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::picture::{Kind, Picture};
use crate::run::Posed;
use image::{ImageDecoder as _, ImageFormat, ImageReader};
use io_colmap::{Model, PhotoHeader, Scene, without_ending};
use png::{BitDepth, ColorType};
use rayon::prelude::*;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Which photos a tool reads as they are: those of these formats, by their content, with 8 bits and without alpha.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Accepts {
    formats: &'static [ImageFormat],
    /// Whether it makes colours of grey ones itself.
    grey: bool,
    /// Whether it looks at names, and knows `.png` and `.jpg` in small letters only.
    plain_endings: bool,
}

impl Accepts {
    /// What Pillow and Rust's `image` read alike; of TIFF there are too many kinds.
    pub(crate) const ANY: Self = Self {
        formats: &[ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP],
        grey: true,
        plain_endings: false,
    };
    pub(crate) const PNG_AND_JPEG: Self = Self {
        formats: &[ImageFormat::Png, ImageFormat::Jpeg],
        ..Self::ANY
    };
    pub(crate) const PNG: Self = Self {
        formats: &[ImageFormat::Png],
        ..Self::ANY
    };
    /// PNG and JPEG in colours, under names that a plain listing finds.
    pub(crate) const LISTED: Self = Self {
        grey: false,
        plain_endings: true,
        ..Self::PNG_AND_JPEG
    };
    /// The same with PNG alone.
    pub(crate) const LISTED_PNG: Self = Self {
        formats: &[ImageFormat::Png],
        ..Self::LISTED
    };
}

/// The photos of a scene under the names they will have.
pub(crate) struct Photos<'a> {
    scene: &'a Scene,
    posed: &'a [Posed<'a>],
    /// Below the image folder, with the ending of the format that they have there.
    pub(crate) names: Vec<String>,
    anew: Vec<bool>,
}

impl<'a> Photos<'a> {
    /// Photos are copied unless they have to be written anew, as PNG: because the tool does not read their format,
    /// would not turn them as their camera sees them, or would take an alpha channel of theirs for a mask. They keep
    /// their names where the ending is one of their format.
    pub(crate) fn plan(
        scene: &'a Scene,
        posed: &'a [Posed<'a>],
        accepts: Accepts,
    ) -> Result<Self, ExportError> {
        let copied: Vec<Option<ImageFormat>> = posed
            .par_iter()
            .map(|posed| {
                let path = scene.image_path(posed.view);
                let header = PhotoHeader::read(&path)?;
                let turned = header.is_turned_for((posed.camera.width, posed.camera.height));
                if header.has_alpha || turned {
                    return Ok(None);
                }
                Ok(accepts.as_it_is(&path))
            })
            .collect::<Result<_, ExportError>>()?;
        let names = posed
            .iter()
            .zip(&copied)
            .map(|(posed, format)| {
                accepts.named(&posed.view.name, format.unwrap_or(ImageFormat::Png))
            })
            .collect();
        Ok(Self {
            scene,
            posed,
            names,
            anew: copied.iter().map(Option::is_none).collect(),
        })
    }

    /// Writes all of them below `folder` under their names.
    pub(crate) fn write(&self, draft: &Draft, folder: &str) -> Result<(), ExportError> {
        self.write_as(draft, |i| format!("{folder}/{}", self.names[i]))
    }

    /// Writes all of them under other names.
    pub(crate) fn write_as(
        &self,
        draft: &Draft,
        name: impl Fn(usize) -> String + Sync,
    ) -> Result<(), ExportError> {
        (0..self.posed.len()).into_par_iter().try_for_each(|i| {
            let from = self.scene.image_path(self.posed[i].view);
            if !self.anew[i] {
                return draft.copy(&from, &name(i));
            }
            let photo = self.scene.read_photo(self.posed[i].view)?.into_rgb8();
            Picture {
                width: photo.width(),
                height: photo.height(),
                kind: Kind::Rgb,
                remark: "a photo, upright and without alpha",
                bytes: photo.as_raw(),
            }
            .write(draft, &name(i))
        })
    }

    /// The model with the names that photos have here.
    pub(crate) fn model(&self) -> Model {
        renamed(&self.scene.model, self.posed, &self.names)
    }

    /// Sentences about photos that are not what they were.
    pub(crate) fn notes(&self) -> Vec<String> {
        let count = |is: &dyn Fn(usize) -> bool| (0..self.anew.len()).filter(|i| is(*i)).count();
        let anew = count(&|i| self.anew[i]);
        let renamed = count(&|i| !self.anew[i] && self.names[i] != self.posed[i].view.name);
        let mut notes = Vec::new();
        if anew > 0 {
            notes.push(format!("{anew} photos are written anew as PNG"));
        }
        if renamed > 0 {
            notes.push(format!(
                "{renamed} photos have another ending here, by which the tool finds what they are"
            ));
        }
        notes
    }
}

/// A model with other names for its views, which are sorted by them.
pub(crate) fn renamed(model: &Model, posed: &[Posed<'_>], names: &[String]) -> Model {
    let mut views: Vec<io_colmap::View> = posed
        .iter()
        .zip(names)
        .map(|(posed, name)| io_colmap::View {
            name: name.clone(),
            ..posed.view.clone()
        })
        .collect();
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Model {
        views,
        ..model.clone()
    }
}

impl Accepts {
    /// The format of a photo that the tool reads as it is. One that cannot be read is none, and whoever reads it says why.
    fn as_it_is(self, path: &Path) -> Option<ImageFormat> {
        let reader = ImageReader::open(path).ok()?.with_guessed_format().ok()?;
        let format = reader.format()?;
        let is_plain = match format {
            // `image` makes 8-bit colours of palettes and of single bits, which others leave as they are.
            ImageFormat::Png => {
                let mut decoder = png::Decoder::new(BufReader::new(File::open(path).ok()?));
                let info = decoder.read_header_info().ok()?;
                let kinds = [ColorType::Rgb, ColorType::Grayscale];
                info.bit_depth == BitDepth::Eight && kinds.contains(&info.color_type)
            }
            // Others of these formats have 8 bits.
            _ => true,
        };
        let is_taken = self.formats.contains(&format)
            && is_plain
            && (self.grey || reader.into_decoder().ok()?.color_type().has_color());
        is_taken.then_some(format)
    }

    /// A photo's name with an ending by which the tool finds a file of that format.
    fn named(self, name: &str, format: ImageFormat) -> String {
        let (stem, endings) = (without_ending(name), format.extensions_str());
        let own = name[stem.len()..].trim_start_matches('.');
        let usual = endings.first().copied().unwrap_or_default();
        let fits = match self.plain_endings {
            true => own == usual,
            false => endings
                .iter()
                .any(|ending| own.eq_ignore_ascii_case(ending)),
        };
        if fits {
            name.to_owned()
        } else {
            format!("{stem}.{usual}")
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use image::{DynamicImage, RgbImage};
    use std::fs;

    #[test]
    fn tools_take_what_they_read_whatever_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let rgb = DynamicImage::from(RgbImage::new(4, 3));
        let taken = |picture: &DynamicImage, format: ImageFormat| {
            // Named as phones and web sites do.
            let path = dir.path().join("a.jpg");
            picture.save_with_format(&path, format).unwrap();
            [
                Accepts::ANY,
                Accepts::PNG_AND_JPEG,
                Accepts::PNG,
                Accepts::LISTED,
            ]
            .map(|accepts| accepts.as_it_is(&path).is_some())
        };
        assert_eq!(taken(&rgb, ImageFormat::Png), [true; 4]);
        assert_eq!(taken(&rgb, ImageFormat::Jpeg), [true, true, false, true]);
        assert_eq!(taken(&rgb, ImageFormat::WebP), [true, false, false, false]);
        assert_eq!(taken(&rgb, ImageFormat::Tiff), [false; 4]);
        let float = rgb.to_rgb32f().into();
        assert_eq!(taken(&float, ImageFormat::OpenExr), [false; 4]);
        let deep = rgb.to_rgb16().into();
        assert_eq!(taken(&deep, ImageFormat::Png), [false; 4]);
        assert_eq!(taken(&deep, ImageFormat::Tiff), [false; 4]);
        let grey = rgb.to_luma8().into();
        assert_eq!(taken(&grey, ImageFormat::Png), [true, true, true, false]);
        assert_eq!(taken(&grey, ImageFormat::Jpeg), [true, true, false, false]);

        let path = dir.path().join("palette.png");
        let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 2, 1);
        encoder.set_color(ColorType::Indexed);
        encoder.set_palette(vec![1, 2, 3, 4, 5, 6]);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[0, 1]).unwrap();
        writer.finish().unwrap();
        assert_eq!(Accepts::ANY.as_it_is(&path), None);
    }

    #[test]
    fn names_end_as_their_format_has_it() {
        for (name, format, any, listed) in [
            ("a.png", ImageFormat::Png, "a.png", "a.png"),
            ("b/a.PNG", ImageFormat::Png, "b/a.PNG", "b/a.png"),
            ("a.JPEG", ImageFormat::Jpeg, "a.JPEG", "a.jpg"),
            ("a.b.jpg", ImageFormat::Png, "a.b.png", "a.b.png"),
            ("a.png", ImageFormat::Jpeg, "a.jpg", "a.jpg"),
            ("a", ImageFormat::WebP, "a.webp", "a.webp"),
        ] {
            assert_eq!(Accepts::ANY.named(name, format), any);
            assert_eq!(Accepts::LISTED.named(name, format), listed);
        }
    }
}
