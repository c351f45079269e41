//! `sos degrade`: rough masks to start a test from.

use super::DegradeArgs;
use super::answer::Voice;
use super::input::check_free;
use serde_json::json;
use sos_eval::degrade_folder;
use std::io::Write as _;

/// Writes true masks with a fault.
pub(super) fn write(args: &DegradeArgs) -> anyhow::Result<()> {
    check_free(&args.out)?;
    let written = degrade_folder(
        &args.gt,
        &args.photos,
        args.fault,
        args.share,
        args.seed,
        &args.out,
    )?;
    for note in &written.notes {
        let _ = writeln!(std::io::stderr(), "{note}");
    }
    let count = written.count;
    let result = json!({ "folder": args.out, "masks": count, "notes": written.notes });
    let sentence = format!("{}: {count} masks", args.out.display());
    Voice::of(args.json, false).answer(&result, &sentence)
}
