//! `sos import`, and the import that `sos train` makes of a scene that is not COLMAP's.

use super::answer::Voice;
use super::capture::refuse_one_photo;
use super::input::{Plan, coarse_masks_hint, mask_source, owns_scene};
use super::train::folder;
use super::{ImportArgs, TrainArgs, program};
use crate::error::InputError;
use crate::export::check_names;
use crate::progress::Progress;
use crate::run_folder::RunFolder;
use scene_export::quoted;
use scene_import::{Detected, Format, MaskOptions, MaskSource, detect, read};
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Makes a COLMAP scene of a folder.
pub(super) fn import(args: &ImportArgs) -> anyhow::Result<()> {
    let detected = detect(&args.scene, args.format)?;
    let options = MaskOptions {
        source: mask_source(args.masks.as_deref()),
        label: args.label,
        polarity: args.polarity.map(Into::into),
        ignore: None,
    };
    let say = |text: &str| {
        if !args.quiet {
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    };
    let written = opened(&detected, args.images.as_deref(), &say)?.write(&args.out, &options)?;
    for note in &written.notes {
        say(note);
    }
    if written.masks == 0
        && options.source == MaskSource::Look
        && let Some(hint) = coarse_masks_hint(&detected.root)
    {
        say(&hint);
    }
    let result = json!({
        "scene": args.out,
        "photos": written.photos,
        "masks": written.masks,
        "notes": written.notes,
    });
    let sentence = format!(
        "{}: {} photos with poses, {} masks; train on it with: {} train {}",
        args.out.display(),
        written.photos,
        written.masks,
        program(),
        quoted(&args.out)
    );
    Voice::of(args.json, args.quiet).answer(&result, &sentence)
}

/// What a run's scene was made from.
pub(super) struct Imported {
    pub(super) from: PathBuf,
    pub(super) masks_dir: Option<PathBuf>,
    /// Its poses were found by COLMAP for this run, which may have taken an hour.
    pub(super) captured: bool,
}

/// Whether the folder can be trained on as it is: a COLMAP model, and masks in a folder or none.
pub(super) fn is_ready(
    scene: &Path,
    masks: &MaskSource,
    label: Option<u32>,
) -> anyhow::Result<bool> {
    let plain_masks = match masks {
        MaskSource::Look | MaskSource::None => true,
        MaskSource::Alpha => false,
        MaskSource::Path(path) => !path.is_file(),
    };
    refuse_one_photo(scene)?;
    let detected = detect(scene, None)?;
    Ok(detected.format == Format::Colmap && !scene.is_file() && plain_masks && label.is_none())
}

/// Imports a scene into the folder of a run, which is made once the poses are read.
pub(super) fn import_for_run(
    args: &TrainArgs,
    plan: &Plan,
    scene: &Path,
    screen: &Progress,
) -> anyhow::Result<(RunFolder, Imported)> {
    let detected = detect(scene, None)?;
    let imported = opened(&detected, None, &|text| screen.note(text))?;
    let may_replace = owns_scene(&plan.out);
    let run = folder(args, &plan.out)?;
    let made = free_scene_dir(&run, may_replace)
        .and_then(|()| write_into_run(&imported, &run, plan, plan.masks.clone(), screen));
    let masks_dir = made.inspect_err(|_| {
        // A new folder goes, what was there stays. The error that is on its way says
        // more than one from tidying up.
        let _ = run.abandon(false);
    })?;
    if masks_dir.is_none()
        && plan.masks == MaskSource::Look
        && let Some(hint) = coarse_masks_hint(&detected.root)
    {
        screen.note(&hint);
    }
    let imported = Imported {
        from: scene.to_path_buf(),
        masks_dir,
        captured: false,
    };
    Ok((run, imported))
}

/// An error if something that no run made is where a run's scene goes.
pub(super) fn free_scene_dir(run: &RunFolder, may_replace: bool) -> anyhow::Result<()> {
    let dir = run.scene_dir();
    if dir.exists() && !may_replace {
        return Err(InputError::new(
            &dir,
            "it is in the way: the imported scene goes there, and no run made this one",
            "train on it, move it, or choose another folder with --out",
        )
        .into());
    }
    Ok(())
}

/// Writes an imported scene into a run's folder; says so. Returns the folder of its masks, if it has
/// any.
pub(super) fn write_into_run(
    imported: &scene_import::Imported,
    run: &RunFolder,
    plan: &Plan,
    source: MaskSource,
    screen: &Progress,
) -> anyhow::Result<Option<PathBuf>> {
    let options = MaskOptions {
        source,
        label: plan.label,
        polarity: plan.polarity.map(Into::into),
        ignore: plan.ignore.clone(),
    };
    let unfinished = run.fresh_scene_dir()?;
    let written = imported.write(&unfinished, &options)?;
    run.take_scene(&unfinished)?;
    for note in &written.notes {
        screen.note(note);
    }
    let dir = run.scene_dir();
    screen.note(&format!(
        "{} photos and {} masks are now a COLMAP scene in {}, which this run works on",
        written.photos,
        written.masks,
        dir.display()
    ));
    Ok((written.masks > 0).then(|| dir.join("masks")))
}

/// Reads the poses and says what was found and what was left out.
fn opened(
    detected: &Detected,
    images: Option<&Path>,
    say: &dyn Fn(&str),
) -> anyhow::Result<scene_import::Imported> {
    say(&detected.sentence());
    let imported = read(detected, images)?;
    for sentence in imported.dropped_sentences() {
        say(&sentence);
    }
    // What training would refuse later is refused now.
    let names = imported.model.views.iter().map(|view| view.name.as_str());
    check_names(&detected.root, names)?;
    Ok(imported)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn one_photo_is_called_so() {
        let dir = tempfile::tempdir().unwrap();
        let photo = dir.path().join("cat.jpg");
        std::fs::write(&photo, "").unwrap();
        let error = is_ready(&photo, &MaskSource::Look, None).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("cat.jpg: it is one photo; give the folder")
        );
    }
}
