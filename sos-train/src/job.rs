//! What training is given and what it comes back with: the seam between the command line and the
//! training loop.

use crate::config::TrainConfig;
use crate::discover::Hint;
use crate::live::Live;
use crate::run_folder::RunFolder;
use io_colmap::{MaskSet, Scene};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Whether a scene is checked before it is trained on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Checks {
    /// Those of [`crate::doctor`]: warnings are said, a failure stops the run.
    #[default]
    Make,
    /// None.
    Skip,
}

/// Everything one call of `train::run` needs.
#[derive(Debug)]
pub struct TrainJob {
    /// Checked with [`TrainConfig::validate`], its steps settled with [`TrainConfig::settled`].
    pub config: TrainConfig,
    /// The scene as the user named it: what was imported, if it was.
    pub given: PathBuf,
    /// Whether the scene is checked before anything is trained.
    pub checks: Checks,
    /// What lies in its folder, opened and checked.
    pub scene: Scene,
    /// Coarse masks, found and matched, if there are any.
    pub masks: Option<MaskSet>,
    /// Where photos are not to be learned from: people who walk by, a watermark.
    pub ignored: Option<MaskSet>,
    /// Where the object is, for a run that looks for it: without masks, or with few.
    pub hint: Hint,
    /// Where everything goes.
    pub run: RunFolder,
    /// Go on from the run's checkpoint.
    pub resume: bool,
    /// Print nothing but errors.
    pub quiet: bool,
    /// Turns true when the user wants to stop: save a checkpoint and return
    /// [`TrainOutcome::Interrupted`].
    pub interrupt: Arc<AtomicBool>,
    /// The board of a page that shows the run, and asks things of it.
    pub live: Option<Arc<Live>>,
}

/// How training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainOutcome {
    /// Trained and exported to the end.
    Finished,
    /// Stopped at the user's wish while still looking for the object: there is nothing to go on from.
    NotBegun,
    /// Stopped at the user's wish; a checkpoint is saved.
    Interrupted {
        /// The step the run goes on from.
        step: u32,
    },
}
