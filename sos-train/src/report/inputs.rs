//! What a report is made of.

use super::ReportError;
use crate::audit::{Metrics, RunAudit};
use crate::config::{MaskPolarity, RunRecord, TrainConfig, Versions};
use crate::export::read_log;
use crate::run_folder::{RunError, RunFolder};
use io_colmap::{MaskSet, Scene};
use serde_json::{Map, Value};
use std::fs;
use std::path::PathBuf;

/// Everything a report shows, apart from the pictures.
#[derive(Debug, Clone)]
pub struct ReportInputs {
    /// The scene's name.
    pub title: String,
    /// The run's configuration.
    pub config: TrainConfig,
    /// What made it.
    pub versions: Versions,
    /// Photos.
    pub scene: Scene,
    /// Coarse masks.
    pub masks: Option<MaskSet>,
    /// Where photos were not learned from.
    pub ignore: Option<PathBuf>,
    /// Folder of reference mattes, matched by stem and shown beside the run's own.
    pub reference: Option<PathBuf>,
    /// What was detected or decided, a sentence each.
    pub notes: Vec<String>,
    /// The run's log.
    pub log: Vec<Map<String, Value>>,
    /// The run's scores, if it was evaluated.
    pub metrics: Option<sos_eval::Report>,
    /// What the results say about themselves, if they were asked.
    pub audit: Option<RunAudit>,
}

impl ReportInputs {
    /// Collects everything from a run's folder and the scene it names.
    ///
    /// # Errors
    /// [`ReportError`] if the run is incomplete, or its photos or masks are gone.
    pub fn gather(run: &RunFolder) -> Result<Self, ReportError> {
        let path = run.config_path();
        let bad = |reason: String| ReportError::Config {
            path: path.clone(),
            reason,
        };
        let text = fs::read_to_string(&path).map_err(|e| RunError::io("read", &path, e))?;
        let record = RunRecord::from_toml(&text).map_err(|e| bad(e.to_string()))?;
        let input = record.input.ok_or_else(|| {
            bad(
                "the section [input] is missing; make the report of a run that sos train wrote"
                    .to_owned(),
            )
        })?;
        // A run that made its scene takes it along when it is moved.
        let inside = run.scene_dir();
        let scene_dir = if input.owns_scene() && inside.is_dir() {
            inside
        } else {
            input.scene.clone()
        };
        let masks_dir = match &input.masks {
            Some(masks) if input.owns_scene() => match masks.strip_prefix(&input.scene) {
                Ok(below) => Some(scene_dir.join(below)),
                Err(_) => Some(masks.clone()),
            },
            other => other.clone(),
        };
        // Masks that the run found are what it started from.
        let (masks_dir, polarity) = if run.has_found_masks() {
            (Some(run.found_masks_dir()), Some(MaskPolarity::White))
        } else {
            (masks_dir, input.polarity)
        };
        let mut scene = Scene::open(&scene_dir)?;
        scene.take_poses(&run.cameras_dir())?;
        let masks = masks_dir
            .as_deref()
            .map(|dir| MaskSet::find(dir, &scene, polarity.map(MaskPolarity::into)))
            .transpose()?;
        let log = read_log(run)?;
        let Metrics { scores, audit } = Metrics::read(run);
        Ok(Self {
            title: if input.demo {
                "Demo scene".to_owned()
            } else {
                let named = input.imported_from.as_ref().unwrap_or(&input.scene);
                named.file_name().map_or_else(
                    || "scene".to_owned(),
                    |name| name.to_string_lossy().into_owned(),
                )
            },
            config: record.config,
            versions: record.versions.unwrap_or_else(Versions::current),
            notes: notes(&scene, masks.as_ref(), &log),
            reference: Some(scene_dir.join("alpha_gt")).filter(|dir| input.demo && dir.is_dir()),
            scene,
            masks,
            ignore: input.ignore_beside(&scene_dir),
            log,
            metrics: scores,
            audit,
        })
    }
}

/// Notes on scene and masks, then those of the log; each once.
fn notes(scene: &Scene, masks: Option<&MaskSet>, log: &[Map<String, Value>]) -> Vec<String> {
    let logged = log
        .iter()
        .filter(|line| line.get("event").is_some_and(|event| event == "note"))
        .filter_map(|line| line.get("text").and_then(Value::as_str));
    let all = scene
        .notes
        .iter()
        .chain(masks.iter().flat_map(|masks| &masks.notes))
        .map(String::as_str)
        .chain(logged);
    let mut notes: Vec<String> = Vec::new();
    for note in all {
        if !notes.iter().any(|known| known == note) {
            notes.push(note.to_owned());
        }
    }
    notes
}
