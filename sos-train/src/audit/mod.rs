//! What a run's results say about themselves, without any ground truth.
//!
//! * **Mask audit**: in every view, the overlap of the start mask and the matte that all views agreed
//!   on. Views with little overlap are those whose start mask was wrong, or whose matte is.
//! * **Cross-view consistency**: whatever one view's matte calls the object is taken to where its depth
//!   says that it is, and looked at from the neighbouring views. `audit/consistency.rs` and
//!   `docs/report.md` define the score.
//! * **Uncertainty**: per pixel, how soft the matte is and how much the other views disagree
//!   (`audit/uncertainty.rs`).
//!
//! Everything is computed from the run's own `alpha/` and `depth/` and the scene's photos in seconds,
//! so that it can be repeated at any time.

mod consistency;
mod depth;
mod metrics;
mod reduced;
mod uncertainty;

pub use metrics::{AuditedView, Metrics, RunAudit};

use crate::report::ReportError;
use crate::run_folder::RunFolder;
use consistency::{Vote, neighbours, votes_in};
use io_colmap::{MaskSet, Scene};
use rayon::prelude::*;
use reduced::{Outline, ReducedView};

/// Audits a run whose mattes are written, and writes `uncertainty/`. Views without a matte are left
/// out; those without a depth have no consistency.
///
/// # Errors
/// [`ReportError`] naming the picture that cannot be read, or the file that cannot be written.
pub fn audit(
    run: &RunFolder,
    scene: &Scene,
    masks: Option<&MaskSet>,
) -> Result<RunAudit, ReportError> {
    let loaded: Vec<Option<ReducedView>> = (0..scene.model.views.len())
        .into_par_iter()
        .map(|index| ReducedView::load(run, scene, masks, index))
        .collect::<Result<_, _>>()?;
    let views: Vec<ReducedView> = loaded.into_iter().flatten().collect();
    let around = neighbours(&views);
    let audited: Vec<AuditedView> = (0..views.len())
        .into_par_iter()
        .map(|i| {
            let view = &views[i];
            let votes = votes_in(&views, i, &around[i], Outline::Matte);
            let by_masks = votes_in(&views, i, &around[i], Outline::StartMask);
            let mean = uncertainty::write(run, view, &votes)?;
            Ok(AuditedView {
                name: view.name.clone(),
                mask_iou: view.mask_iou,
                consistency: Vote::consistency(&votes),
                mask_consistency: Vote::consistency(&by_masks),
                uncertainty: mean,
            })
        })
        .collect::<Result<_, ReportError>>()?;
    Ok(RunAudit::of(audited))
}
