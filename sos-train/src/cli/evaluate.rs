//! `sos eval` and `sos report`.

use super::answer::Voice;
use super::input::read_record;
use super::train::stated_device;
use super::{CompareArgs, EvalArgs, ReportArgs, program};
use crate::audit::{Metrics, audit};
use crate::error::InputError;
use crate::report::{ReportInputs, comparison_page, write_report};
use crate::run_folder::{RunFolder, write_whole};
use scene_export::{has_ended, quoted};
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
                Ok(_) => {}
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
    for contender in &contenders {
        refuse_without_mattes(&contender.dir)?;
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
    if let Some(unfinished) = make_report(&run, args.gt.as_deref())? {
        let _ = writeln!(std::io::stderr(), "{unfinished}");
    }
    let path = run.report_path();
    let sentence = path.display().to_string();
    Voice::of(args.json, false).answer(&json!({ "report": path }), &sentence)
}

/// An error for a run that has drawn no mattes yet: it would count as a folder of masks.
fn refuse_without_mattes(dir: &Path) -> Result<(), InputError> {
    // Other tools' folders may have a file of that name.
    let is_run =
        read_record(&dir.join("config.toml")).is_ok_and(|(record, _)| record.input.is_some());
    if !is_run || dir.join("alpha").is_dir() {
        return Ok(());
    }
    Err(InputError::new(
        dir,
        "this run has drawn no mattes yet",
        format!(
            "let it come to its end: {} train --resume --out {}",
            program(),
            quoted(dir)
        ),
    ))
}

/// Audits a run and makes its report; the audit goes into `metrics.json`. What is said of a run that has not come to
/// its end is on the page, too.
pub(super) fn make_report(run: &RunFolder, gt: Option<&Path>) -> anyhow::Result<Option<String>> {
    let mut inputs = ReportInputs::gather(run)?;
    let unfinished = (has_ended(run.root()) == Some(false)).then(|| {
        format!(
            "the run has not come to its end, and pictures may be missing; have it go on with: {} train --resume --out {}{}",
            program(),
            quoted(run.root()),
            stated_device(&inputs.config.device)
        )
    });
    inputs.notes.splice(0..0, unfinished.clone());
    inputs.audit = Some(audit(run, &inputs.scene, inputs.masks.as_ref())?);
    Metrics {
        scores: inputs.metrics.clone(),
        audit: inputs.audit.clone(),
    }
    .write(run)?;
    if let Some(gt) = gt {
        inputs.reference = Some(true_mattes(gt));
    }
    write_report(run, &inputs)?;
    Ok(unfinished)
}
