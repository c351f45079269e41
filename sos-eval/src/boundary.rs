//! Boundary IoU (Cheng et al., "Boundary IoU", CVPR 2021): overlap of the masks' rims, which stays
//! sensitive where plain IoU of a large object no longer moves.

use crate::iou::iou;
use crate::picture::{Mask, assert_same_size};

/// Width of the band as a share of the picture's diagonal, as Cheng et al. have it.
pub const BOUNDARY_SHARE: f64 = 0.02;

/// Band width in pixels: `max(1, round(share * sqrt(width^2 + height^2)))`, halves to even.
pub fn band_width(width: usize, height: usize, share: f64) -> usize {
    let diagonal = (width as f64).hypot(height as f64);
    ((share * diagonal).round_ties_even() as usize).max(1)
}

/// The pixels of `mask` within `distance` pixels of its contour.
///
/// `band(M) = M \ erode(M, d)`, erosion by the square of `2 d + 1` pixels, everything outside the
/// picture counting as background. That is the definition in the authors' code (`d` erosions
/// with a 3x3 square), i.e. the Chebyshev distance, so that numbers can be compared. Linear time: a
/// square is counted with four reads of a summed-area table.
pub fn boundary_band(mask: &Mask, distance: usize) -> Mask {
    let (width, height) = (mask.width, mask.height);
    let stride = width + 1;
    let mut sums = vec![0_u32; stride * (height + 1)];
    for y in 0..height {
        let mut row = 0;
        for x in 0..width {
            row += u32::from(mask.inside[y * width + x]);
            sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
        }
    }
    let side = 2 * distance + 1;
    let mut band = mask.inside.clone();
    for y in distance..height.saturating_sub(distance) {
        let (top, bottom) = ((y - distance) * stride, (y + distance + 1) * stride);
        for x in distance..width.saturating_sub(distance) {
            let (left, right) = (x - distance, x + distance + 1);
            let inside =
                sums[bottom + right] + sums[top + left] - sums[top + right] - sums[bottom + left];
            if inside as usize == side * side {
                band[y * width + x] = false;
            }
        }
    }
    Mask {
        width,
        height,
        inside: band,
    }
}

/// `|band(P) ∩ band(T)| / |band(P) ∪ band(T)|` with bands of `distance` pixels; 1 if both masks are
/// empty. Use [`band_width`] with [`BOUNDARY_SHARE`] for the published definition.
///
/// # Panics
/// If the sizes differ.
pub fn boundary_iou(pred: &Mask, truth: &Mask, distance: usize) -> f64 {
    assert_same_size("boundary_iou", pred, truth);
    iou(
        &boundary_band(pred, distance),
        &boundary_band(truth, distance),
    )
}
