//! `sos eval` and `sos report`.

use super::answer::Voice;
use super::{CompareArgs, EvalArgs, ReportArgs};
use crate::audit::{Metrics, audit};
use crate::error::InputError;
use crate::report::{ReportInputs, comparison_page, write_report};
use crate::run_folder::{RunFolder, write_whole};
use serde_json::json;
use sos_eval::{Contender, compare_contenders, true_mattes};
use std::io::Write as _;
use std::path::Path;

/// Views listed as the worst.
const WORST: usize = 5;

/// Scores a run. What lies in a run's folder is brought up to date; into a folder that is none,
/// nothing is written.
pub(super) fn eval(args: &EvalArgs) -> anyhow::Result<()> {
    let report = sos_eval::run_eval(&args.run, &args.gt, args.start.as_deref())?;
    if let Ok(run) = RunFolder::open_existing(&args.run) {
        Metrics {
            scores: Some(report.clone()),
            ..Metrics::read(&run)
        }
        .write(&run)?;
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
    Voice::of(args.json, false).answer(&report, &report.table(WORST))
}

/// Scores several results beside each other.
pub(super) fn compare(args: &CompareArgs) -> anyhow::Result<()> {
    let contenders: Vec<Contender> = args
        .contenders
        .iter()
        .map(|c| Contender::parse(c))
        .collect();
    for (i, contender) in contenders.iter().enumerate() {
        let name = &contender.name;
        if contenders[..i].iter().any(|other| other.name == *name) {
            let wrong = format!("two of the entries are called {name}");
            let remedy = "give each a name of its own, as in NAME=DIR";
            return Err(InputError::new(&contender.dir, wrong, remedy).into());
        }
    }
    let comparison = compare_contenders(&contenders, &args.gt)?;
    // First: a command that fails has no answer.
    if let Some(path) = &args.page {
        let page = comparison_page(&comparison, &contenders, &args.gt)?;
        write_whole(path, page.as_bytes())?;
    }
    Voice::of(args.json, false).answer(&comparison, &comparison.table())
}

/// Makes a run's report again.
pub(super) fn report(args: &ReportArgs) -> anyhow::Result<()> {
    let run = RunFolder::open_existing(&args.run)?;
    if let Some(gt) = args.gt.as_deref().filter(|gt| !gt.is_dir()) {
        let remedy = "give the folder of the reference mattes, or leave --gt out";
        return Err(InputError::new(gt, "there is no such folder", remedy).into());
    }
    make_report(&run, args.gt.as_deref())?;
    let path = run.report_path();
    let sentence = path.display().to_string();
    Voice::of(args.json, false).answer(&json!({ "report": path }), &sentence)
}

/// Audits a run and makes its report; the audit goes into `metrics.json`.
pub(super) fn make_report(run: &RunFolder, gt: Option<&Path>) -> anyhow::Result<()> {
    let mut inputs = ReportInputs::gather(run)?;
    inputs.audit = Some(audit(run, &inputs.scene, inputs.masks.as_ref())?);
    Metrics {
        scores: inputs.metrics.clone(),
        audit: inputs.audit.clone(),
    }
    .write(run)?;
    if let Some(gt) = gt {
        inputs.reference = Some(true_mattes(gt));
    }
    Ok(write_report(run, &inputs)?)
}
