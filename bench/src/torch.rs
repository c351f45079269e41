//! The same step in PyTorch, for the ratio.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

use crate::equal::Sizes;

/// The script, so that the program runs from anywhere.
const SCRIPT: &str = include_str!("../torch_step.py");

/// What the script prints.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct TorchFigures {
    pub(crate) version: String,
    pub(crate) threads: usize,
    pub(crate) samples_per_s: f64,
    pub(crate) step_ms: f64,
    pub(crate) backward_ms: f64,
    pub(crate) adam_ms: f64,
}

/// Whether `python` has PyTorch.
pub(crate) fn is_installed(python: &Path) -> bool {
    Command::new(python)
        .args(["-c", "import torch"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Runs the PyTorch step.
pub(crate) fn measure(python: &Path, sizes: Sizes, threads: usize) -> Result<TorchFigures> {
    let mut child = Command::new(python)
        .arg("-")
        .args(["--rays", &sizes.rays.to_string()])
        .args(["--samples", &sizes.samples.to_string()])
        .args(["--threads", &threads.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("{} does not start", python.display()))?;
    if let Some(mut stdin) = child.stdin.take() {
        stdin.write_all(SCRIPT.as_bytes())?;
    }
    let output = child.wait_with_output()?;
    anyhow::ensure!(
        output.status.success(),
        "the PyTorch step failed; its message stands above"
    );
    serde_json::from_slice(&output.stdout).context("the PyTorch step printed something unexpected")
}
