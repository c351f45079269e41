//! What an evaluation found, in the form it has as JSON.

use crate::boundary::{BOUNDARY_SHARE, band_width, boundary_iou};
use crate::iou::Overlap;
use crate::matting::{connectivity_error, gradient_error, mse, sad};
use crate::mesh::MeshScore;
use crate::picture::Plane;
use crate::plates::PlateScore;
use serde::{Deserialize, Serialize};

/// Alpha at which a pixel counts as inside: `a >= 0.5`.
pub const MASK_THRESHOLD: f32 = 0.5;

/// All scores of one alpha matte, or their mean over views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AlphaScore {
    /// Foreground intersection over union at [`MASK_THRESHOLD`]: the headline.
    pub iou: f64,
    /// Mean IoU of foreground and background.
    pub miou: f64,
    /// Pixel accuracy.
    pub acc: f64,
    /// Boundary IoU, band of 2 % of the diagonal.
    pub boundary_iou: f64,
    /// Sum of absolute differences / 1000.
    pub sad: f64,
    /// Mean squared error x 1000.
    pub mse: f64,
    /// Gradient error.
    pub grad: f64,
    /// Connectivity error.
    pub conn: f64,
}

impl AlphaScore {
    /// Mean of each score; `None` for no scores.
    pub fn mean<'a>(scores: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        let mut sum = [0.0; 8];
        let mut n = 0_u32;
        for score in scores {
            sum.iter_mut()
                .zip(score.to_array())
                .for_each(|(sum, value)| *sum += value);
            n += 1;
        }
        (n > 0).then(|| Self::from_array(sum.map(|sum| sum / f64::from(n))))
    }

    /// The scores in the order of their fields.
    pub fn to_array(&self) -> [f64; 8] {
        [
            self.iou,
            self.miou,
            self.acc,
            self.boundary_iou,
            self.sad,
            self.mse,
            self.grad,
            self.conn,
        ]
    }

    fn from_array([iou, miou, acc, boundary_iou, sad, mse, grad, conn]: [f64; 8]) -> Self {
        Self {
            iou,
            miou,
            acc,
            boundary_iou,
            sad,
            mse,
            grad,
            conn,
        }
    }
}

/// Scores a matte `[height, width]` against the true one.
///
/// # Panics
/// If the sizes differ.
pub fn score_alpha(pred: &Plane, truth: &Plane) -> AlphaScore {
    let (pred_mask, truth_mask) = (pred.mask(MASK_THRESHOLD), truth.mask(MASK_THRESHOLD));
    let overlap = Overlap::count(&pred_mask, &truth_mask);
    let band = band_width(truth.width, truth.height, BOUNDARY_SHARE);
    AlphaScore {
        iou: overlap.iou(),
        miou: overlap.miou(),
        acc: overlap.accuracy(),
        boundary_iou: boundary_iou(&pred_mask, &truth_mask, band),
        sad: sad(pred, truth),
        mse: mse(pred, truth),
        grad: gradient_error(pred, truth),
        conn: connectivity_error(pred, truth),
    }
}

/// Scores of one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// Name of the true matte's file, without extension.
    pub name: String,
    /// Its scores.
    #[serde(flatten)]
    pub score: AlphaScore,
}

/// Everything an evaluation found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// One entry per true matte, by name.
    pub views: Vec<ViewScore>,
    /// Mean over the views; a missing prediction counts as an empty matte.
    pub mean: AlphaScore,
    /// The same mean for the masks the run started from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<AlphaScore>,
    /// Background plates, against the scene as it is lit while the object stands in it, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate: Option<PlateScore>,
    /// The same plates against the scene without the object, its shadow and its reflection, where both are
    /// known: what is filled in where no view saw anything is judged here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clean_plate: Option<PlateScore>,
    /// The mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshScore>,
    /// Views without a predicted matte.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// Views without a start mask.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub start_missing: Vec<String>,
    /// What was there but could not be scored, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}
