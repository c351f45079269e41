//! How much a photo changes at a pixel.

use image::RgbImage;

/// The length of Sobel's gradient over all channels of an 8-bit photo. `x` and `y` are not on its border.
pub(crate) fn edge_strength(photo: &RgbImage, x: u32, y: u32) -> f32 {
    let at = |dx: u32, dy: u32, channel: usize| {
        f32::from(photo.get_pixel(x + dx - 1, y + dy - 1).0[channel])
    };
    let squared = |channel: usize| {
        let across = |of: &dyn Fn(u32, u32) -> f32| {
            (of(2, 0) + 2.0 * of(2, 1) + of(2, 2)) - (of(0, 0) + 2.0 * of(0, 1) + of(0, 2))
        };
        let x = across(&|dx, dy| at(dx, dy, channel));
        let y = across(&|dx, dy| at(dy, dx, channel));
        x * x + y * y
    };
    (0..3).map(squared).sum::<f32>().sqrt()
}
