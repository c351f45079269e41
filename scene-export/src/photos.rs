//! The scene's photos beside what is exported: copied where that will do, else written anew.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::picture::{Kind, Picture};
use crate::run::Posed;
use io_colmap::{Model, PhotoHeader, Scene, without_ending};
use rayon::prelude::*;
use std::fs;
use std::path::Path;

/// Which photos a tool reads as they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Accepts {
    /// All that are read here.
    Any,
    /// PNG and JPEG.
    PngAndJpeg,
    /// PNG only.
    Png,
}

/// The photos of a scene under the names they will have.
pub(crate) struct Photos<'a> {
    scene: &'a Scene,
    posed: &'a [Posed<'a>],
    /// Below the image folder; those that are written anew become PNG files.
    pub(crate) names: Vec<String>,
    anew: Vec<bool>,
}

impl<'a> Photos<'a> {
    /// Photos keep their names unless they have to be written anew: because the tool does not read
    /// their format, would not turn them as their camera sees them, or would take an alpha channel of
    /// theirs for a mask.
    pub(crate) fn plan(
        scene: &'a Scene,
        posed: &'a [Posed<'a>],
        accepts: Accepts,
    ) -> Result<Self, ExportError> {
        let anew: Vec<bool> = posed
            .par_iter()
            .map(|posed| {
                let header = PhotoHeader::read(&scene.image_path(posed.view))?;
                let turned = header.is_turned_for((posed.camera.width, posed.camera.height));
                Ok(header.has_alpha || turned || !accepts.takes(&posed.view.name))
            })
            .collect::<Result<_, ExportError>>()?;
        let names = posed
            .iter()
            .zip(&anew)
            .map(|(posed, anew)| match anew {
                true => format!("{}.png", without_ending(&posed.view.name)),
                false => posed.view.name.clone(),
            })
            .collect();
        Ok(Self {
            scene,
            posed,
            names,
            anew,
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
                let to = draft.place(&name(i))?;
                fs::copy(&from, &to).map_err(|e| ExportError::io("copy", &from, e))?;
                return Ok(());
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

    /// A sentence about photos that are not what they were.
    pub(crate) fn note(&self) -> Option<String> {
        let count = self.anew.iter().filter(|anew| **anew).count();
        (count > 0).then(|| format!("{count} photos are written anew as PNG"))
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
    fn takes(self, name: &str) -> bool {
        let ending = Path::new(name)
            .extension()
            .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match self {
            Accepts::Any => true,
            Accepts::PngAndJpeg => {
                matches!(ending.as_deref(), Some("png" | "jpg" | "jpeg"))
            }
            Accepts::Png => ending.as_deref() == Some("png"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tools_take_what_they_read() {
        assert!(Accepts::Any.takes("a.webp"));
        assert!(Accepts::PngAndJpeg.takes("a.JPG"));
        assert!(!Accepts::PngAndJpeg.takes("a.webp"));
        assert!(!Accepts::Png.takes("a.jpg"));
        assert!(!Accepts::Png.takes("png"));
    }
}
