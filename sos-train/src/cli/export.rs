//! `sos export`: a run's results in the formats and conventions of other tools.

use super::ExportArgs;
use super::answer::Voice;
use crate::error::InputError;
use scene_export::{Existing, Options, Product, RunLengths, Target};
use serde_json::json;
use std::io::Write as _;
use std::path::Path;

/// Exports a run.
pub(super) fn export(args: &ExportArgs) -> anyhow::Result<()> {
    refuse_options_of_others(args)?;
    let products = args.to.map(Product::Files).into_iter();
    let products = products.chain(args.masks_for.map(Product::Masks));
    let options = Options {
        scene: args.scene.clone(),
        existing: if args.force {
            Existing::Replace
        } else {
            Existing::Keep
        },
        run_lengths: if args.plain_rle {
            RunLengths::Plain
        } else {
            RunLengths::Packed
        },
        rate: args.fps,
    };
    // The command line has one of the two.
    for product in products {
        let out = args
            .out
            .clone()
            .unwrap_or_else(|| product.default_folder(&args.run));
        let written = scene_export::export(&args.run, product, &out, &options)?;
        for note in written.notes.iter().filter(|_| !args.quiet) {
            let _ = writeln!(std::io::stderr(), "{note}");
        }
        let result = json!({
            "folder": written.folder,
            "count": written.count,
            "notes": written.notes,
        });
        Voice::of(args.json, args.quiet).answer(&result, &written.sentence(product))?;
    }
    Ok(())
}

/// An option that would do nothing is a mistake.
fn refuse_options_of_others(args: &ExportArgs) -> Result<(), InputError> {
    let unused = |option: &str, what: &str, target: &str| {
        let remedy = format!("leave it out, or say --to {target}");
        Err(InputError::new(Path::new(option), what, remedy))
    };
    if args.fps.is_some() && args.to != Some(Target::Video) {
        return unused("--fps", "only videos have frames a second", "video");
    }
    if args.plain_rle && args.to != Some(Target::Coco) {
        return unused("--plain-rle", "only COCO has run lengths", "coco");
    }
    Ok(())
}
