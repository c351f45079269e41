//! Photos with an alpha channel: the mask in them, and the photo without it.

use image::{DynamicImage, GrayImage, Rgb, RgbImage};

/// The alpha channel, white where opaque, unless it is the same everywhere and says nothing.
pub(crate) fn mask(photo: &DynamicImage) -> Option<GrayImage> {
    if !photo.color().has_alpha() {
        return None;
    }
    let rgba = photo.to_rgba8();
    let first = rgba.pixels().next()?.0[3];
    rgba.pixels().any(|pixel| pixel.0[3] != first).then(|| {
        GrayImage::from_fn(rgba.width(), rgba.height(), |x, y| {
            image::Luma([rgba.get_pixel(x, y).0[3]])
        })
    })
}

/// The photo without alpha.
///
/// Where everything transparent has one colour, that is a background somebody put there (rendered
/// scenes have black), and soft edges are laid over it: else they would be as bright as the object.
/// Where it has many colours, it is the real photo, which is kept.
pub(crate) fn flatten(photo: &DynamicImage) -> RgbImage {
    if !photo.color().has_alpha() {
        return photo.to_rgb8();
    }
    let rgba = photo.to_rgba8();
    let mut hidden = rgba.pixels().filter(|p| p.0[3] == 0).map(|p| rgb(p.0));
    let backdrop = hidden
        .next()
        .filter(|first| hidden.all(|colour| colour == *first));
    RgbImage::from_fn(rgba.width(), rgba.height(), |x, y| {
        let pixel = rgba.get_pixel(x, y).0;
        let alpha = f32::from(pixel[3]) / 255.0;
        Rgb(match backdrop {
            Some(backdrop) => std::array::from_fn(|c| {
                let over = f32::from(pixel[c]) * alpha + f32::from(backdrop[c]) * (1.0 - alpha);
                over.round() as u8
            }),
            None => rgb(pixel),
        })
    })
}

fn rgb([r, g, b, _]: [u8; 4]) -> [u8; 3] {
    [r, g, b]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use image::RgbaImage;

    fn picture(pixels: [[u8; 4]; 4]) -> DynamicImage {
        RgbaImage::from_raw(2, 2, pixels.concat()).unwrap().into()
    }

    #[test]
    fn rendered_edges_are_laid_over_their_backdrop_and_photos_are_kept() {
        let black = [0, 0, 0, 0];
        let rendered = picture([black, [200, 100, 50, 255], [200, 100, 50, 51], black]);
        let flat = flatten(&rendered);
        assert_eq!(flat.get_pixel(1, 0).0, [200, 100, 50]);
        assert_eq!(flat.get_pixel(0, 1).0, [40, 20, 10]);
        assert_eq!(mask(&rendered).unwrap().into_raw(), [0, 255, 51, 0]);

        let cut = picture([
            [9, 8, 7, 0],
            [200, 100, 50, 255],
            [200, 100, 50, 51],
            [1, 2, 3, 0],
        ]);
        let flat = flatten(&cut);
        assert_eq!(flat.get_pixel(0, 0).0, [9, 8, 7]);
        assert_eq!(flat.get_pixel(0, 1).0, [200, 100, 50]);

        let opaque = picture([[1, 2, 3, 255]; 4]);
        assert_eq!(mask(&opaque), None);
        assert_eq!(mask(&DynamicImage::new_rgb8(2, 2)), None);
    }
}
