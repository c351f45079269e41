//! PNG files that are complete, or an error.

use crate::error::{ColmapError, picture_error};
use image::{EncodableLayout, ImageBuffer, ImageFormat, PixelWithColorType};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::ops::Deref;
use std::path::Path;

/// Writes a picture as a PNG file, whatever the file's name. Its folder has to be there.
///
/// The `save` of `image` drops its buffer as it is: what a full disk does not take of the end is lost, and nobody
/// is told.
///
/// # Errors
/// [`ColmapError::Io`] with the file's name.
pub fn write_png<P, C>(picture: &ImageBuffer<P, C>, path: &Path) -> Result<(), ColmapError>
where
    P: PixelWithColorType,
    [P::Subpixel]: EncodableLayout,
    C: Deref<Target = [P::Subpixel]>,
{
    let write = || {
        let mut out = BufWriter::with_capacity(1 << 16, File::create(path)?);
        picture
            .write_to(&mut out, ImageFormat::Png)
            .map_err(picture_error)?;
        out.flush()
    };
    write().map_err(|e| ColmapError::io("write", path, e))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use image::{GrayImage, Luma};

    #[test]
    fn what_is_written_is_read_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let picture = GrayImage::from_fn(5, 4, |x, y| Luma([(50 * x + y) as u8]));
        write_png(&picture, &path).unwrap();
        assert_eq!(image::open(&path).unwrap().into_luma8(), picture);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_noticed_also_by_a_small_picture() {
        let full = Path::new("/dev/full");
        let said = write_png(&GrayImage::new(4, 4), full).unwrap_err();
        let said = said.to_string();
        assert!(said.starts_with("cannot write /dev/full: "), "{said}");
        assert!(said.ends_with("; free some space"), "{said}");
    }
}
