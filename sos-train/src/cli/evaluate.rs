//! `sos eval` and `sos report`.

use super::{CompareArgs, EvalArgs, ReportArgs, answer};
use crate::report::{ReportInputs, comparison_page, write_report};
use crate::run_folder::{RunError, RunFolder, write_whole};
use sos_eval::{Contender, Report, compare_contenders};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Views listed as the worst.
const WORST: usize = 5;

/// Scores a run. What lies in a run's folder is brought up to date; into a folder that is none,
/// nothing is written.
pub(super) fn eval(args: &EvalArgs) -> anyhow::Result<()> {
    let report = sos_eval::run_eval(&args.run, &args.gt, args.start.as_deref())?;
    answer(&if args.json {
        serde_json::to_string_pretty(&report)?
    } else {
        report.table(WORST)
    });
    if let Ok(run) = RunFolder::open_existing(&args.run) {
        write_metrics(&run, &report)?;
        if run.report_path().is_file() {
            // The scores are there all the same if, say, the photos have moved.
            match make_report(&run, Some(&args.gt)) {
                Ok(()) => {}
                Err(error) => {
                    let text = crate::error::sentence(&error);
                    let _ = writeln!(
                        std::io::stderr(),
                        "warning: {} is as before: {text}",
                        run.report_path().display()
                    );
                }
            }
        }
    }
    Ok(())
}

/// Scores several results beside each other.
pub(super) fn compare(args: &CompareArgs) -> anyhow::Result<()> {
    let contenders: Vec<Contender> = args
        .contenders
        .iter()
        .map(|c| Contender::parse(c))
        .collect();
    let comparison = compare_contenders(&contenders, &args.gt)?;
    answer(&if args.json {
        serde_json::to_string_pretty(&comparison)?
    } else {
        comparison.table()
    });
    if let Some(path) = &args.page {
        let page = comparison_page(&comparison, &contenders, &args.gt)?;
        write_whole(path, page.as_bytes())?;
    }
    Ok(())
}

/// Makes a run's report again.
pub(super) fn report(args: &ReportArgs) -> anyhow::Result<()> {
    let run = RunFolder::open_existing(&args.run)?;
    make_report(&run, args.gt.as_deref())?;
    answer(&run.report_path().display().to_string());
    Ok(())
}

fn make_report(run: &RunFolder, gt: Option<&Path>) -> anyhow::Result<()> {
    let mut inputs = ReportInputs::gather(run)?;
    if let Some(gt) = gt {
        inputs.reference = Some(mattes_in(gt));
    }
    Ok(write_report(run, &inputs)?)
}

/// A scene with true mattes, or their folder itself.
fn mattes_in(gt: &Path) -> PathBuf {
    let inner = gt.join("alpha_gt");
    if inner.is_dir() {
        inner
    } else {
        gt.to_path_buf()
    }
}

/// Writes `metrics.json`.
pub(super) fn write_metrics(run: &RunFolder, report: &Report) -> Result<(), RunError> {
    run.write(&run.metrics_path(), |out| {
        serde_json::to_writer_pretty(&mut *out, report)?;
        writeln!(out)
    })
}
