//! `uncertainty/*.png`: where a matte should not be relied on.
//!
//! ```text
//! u = 1 - (1 - 4 a (1 - a)) (1 - d)
//! ```
//! with the matte `a` (its softness `4 a (1 - a)` is 1 at one half, 0 where it is sure) and the share
//! `d` of looks between the views that object: either is enough to make a pixel uncertain.

use super::consistency::Vote;
use super::reduced::ReducedView;
use crate::export::write_uncertainty;
use crate::report::{ReportError, open_picture};
use crate::run_folder::{RunFolder, view_file};
use image::GrayImage;

/// Writes a view's picture at the matte's size. Returns the sum of its values over the matte's area.
///
/// `votes` has one entry per cell of the reduced view.
pub(super) fn write(
    run: &RunFolder,
    view: &ReducedView,
    votes: &[Vote],
) -> Result<f64, ReportError> {
    // Read again instead of kept: all views at full size would be too many.
    let path = view_file(&run.alpha_dir(), &view.name, "png");
    let alpha = open_picture(&path)?.into_luma16();
    let (width, height) = alpha.dimensions();
    let disagreement: Vec<f32> = votes.iter().map(|vote| vote.disagreement()).collect();
    let (mut sum, mut area) = (0.0, 0.0);
    let mut picture = GrayImage::new(width, height);
    for ((x, y, out), alpha) in picture.enumerate_pixels_mut().zip(alpha.pixels()) {
        let a = f32::from(alpha.0[0]) / 65535.0;
        let u = uncertainty(a, view.squares.between(&disagreement, x, y));
        out.0[0] = (255.0 * u + 0.5) as u8;
        sum += f64::from(u);
        area += f64::from(a);
    }
    write_uncertainty(run, &view.name, &picture)?;
    Ok(sum / f64::max(area, 1.0))
}

fn uncertainty(alpha: f32, disagreement: f32) -> f32 {
    1.0 - (1.0 - 4.0 * alpha * (1.0 - alpha)) * (1.0 - disagreement)
}

#[cfg(test)]
mod tests {
    use super::uncertainty;

    #[test]
    fn either_is_enough() {
        assert_eq!(uncertainty(1.0, 0.0), 0.0);
        assert_eq!(uncertainty(0.0, 0.0), 0.0);
        assert_eq!(uncertainty(0.5, 0.0), 1.0);
        assert_eq!(uncertainty(1.0, 0.25), 0.25);
        assert!((uncertainty(0.9, 0.5) - 0.68).abs() < 1e-6);
    }
}
