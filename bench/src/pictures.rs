//! How long a finished run's pictures take, and the memory they need.

use std::fmt;
use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use rayon::prelude::*;
use serde::Serialize;
use sos_train::render::survey::Survey;
use sos_train::render::trained::load_trained;
use sos_train::render::view::{render_matte, render_view};
use sos_train::run_folder::RunFolder;

/// What drawing a run's views takes, with all cores. Files are read before and none are written.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PictureFigures {
    views: usize,
    /// Of the first view, in pixels.
    width: u32,
    /// Of the first view, in pixels.
    height: u32,
    /// Rays a pixel along the edges of mattes.
    edge_rays: u32,
    /// The mattes of all views and nothing else.
    mattes_seconds: f64,
    /// The coarse look at all views that plates need, once a run.
    survey_seconds: f64,
    /// The first view's matte, cut-out, plate, normals and depths.
    one_view_seconds: f64,
    /// The most memory that this program held at any time, photos included; none where the system does
    /// not tell.
    peak_gib: Option<f64>,
}

/// Draws the views of the finished run in `folder`.
pub(crate) fn measure(folder: &Path) -> Result<PictureFigures> {
    let (scene, data) = load_trained(&RunFolder::open_existing(folder)?)?;
    let (survey, survey_seconds) = timed(|| Survey::new(&scene, &data, || ()));
    let (_, one_view_seconds) = timed(|| render_view(&scene, &data, &survey, 0));
    let peak_gib = peak_gib();
    // Two views at a time, as a run draws them: small ones do not fill all cores by themselves.
    let indices: Vec<usize> = (0..data.views.len()).collect();
    let ((), mattes_seconds) = timed(|| {
        for pair in indices.chunks(2) {
            pair.par_iter()
                .for_each(|&index| drop(render_matte(&scene, &data, index)));
        }
    });
    Ok(PictureFigures {
        views: data.views.len(),
        width: data.views[0].width(),
        height: data.views[0].height(),
        edge_rays: scene.config.export.edge_rays,
        mattes_seconds,
        survey_seconds,
        one_view_seconds,
        peak_gib,
    })
}

/// What `work` returns, and the seconds it took.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let begun = Instant::now();
    let done = work();
    (done, begun.elapsed().as_secs_f64())
}

/// The largest resident set so far, as Linux has it in `/proc/self/status`.
fn peak_gib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / f64::from(1 << 20))
}

impl fmt::Display for PictureFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} views of {}x{}, {} rays a pixel along edges",
            self.views, self.width, self.height, self.edge_rays
        )?;
        writeln!(
            f,
            "    mattes of all views     {:7.1} s",
            self.mattes_seconds
        )?;
        writeln!(
            f,
            "    survey, once for plates {:7.1} s",
            self.survey_seconds
        )?;
        write!(
            f,
            "    one view, all pictures  {:7.1} s",
            self.one_view_seconds
        )?;
        match self.peak_gib {
            Some(peak) => write!(f, "; peak memory up to here {peak:.2} GiB"),
            None => Ok(()),
        }
    }
}
