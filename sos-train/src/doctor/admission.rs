//! The checks that a training begins with: warnings are said, a failure stops it.

use super::Location;
use crate::error::InputError;
use crate::job::TrainJob;
use crate::prepare::{MaskConsensus, TrainView};
use crate::progress::Progress;
use scene_doctor::{Files, Masks, Status, examine, photos_without_pose};

/// A scene that may be trained on.
#[derive(Debug, Default)]
pub struct Admission {
    /// What was warned about, a sentence each.
    pub warnings: Vec<String>,
    /// What the masks say together, for whoever needs it next.
    pub consensus: Option<MaskConsensus>,
}

/// Checks the views of a training.
///
/// # Errors
/// [`InputError`] where a check fails.
pub fn admit(
    job: &TrainJob,
    views: &[TrainView],
    progress: &Progress,
) -> Result<Admission, InputError> {
    let scene = &job.scene;
    let location = Location::find(views, &scene.model.points, &job.hint, &job.config.prepare);
    let masks = match &job.masks {
        Some(masks) => Masks::Found {
            polarity: masks.polarity.to_string(),
            consensus: location.mask_consensus(job.config.prepare.object_threshold),
        },
        None => Masks::None { offered: None },
    };
    let paths: Vec<_> = scene
        .model
        .views
        .iter()
        .map(|view| scene.image_path(view))
        .collect();
    let files = Files {
        unposed: photos_without_pose(&paths, job.masks.iter().flat_map(|m| &m.paths).flatten()),
        ..Files::default()
    };
    let name = job.given.display().to_string();
    let report = examine(&name, &location.exam(views, scene), &files, &masks);
    let mut failures = report.with(Status::Fail);
    if let Some(first) = failures.next() {
        let more = match failures.count() {
            0 => String::new(),
            more => format!(" (and {more} more)"),
        };
        return Err(InputError::new(
            &job.given,
            format!("{}: {}{more}", first.check, first.says),
            format!(
                "{}; sos doctor shows all checks, --skip-checks trains in spite of them",
                first.remedy.as_deref().unwrap_or("choose another scene")
            ),
        ));
    }
    let warnings: Vec<String> = report
        .with(Status::Warn)
        .map(|finding| finding.line())
        .collect();
    for warning in &warnings {
        progress.warn(warning);
    }
    Ok(Admission {
        warnings,
        consensus: location.consensus,
    })
}
