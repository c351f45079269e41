//! Saving a run so that it goes on as if it had never stopped.
//!
//! Random numbers are a function of seed and step, so that what has to be kept is: both fields,
//! sharpnesses, optimiser moments, occupancy, and a few numbers.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::module::Module;
use burn::store::ModuleRecord;
use hashgrid::Hash;
use scene_decomp::SurfaceVotes;
use scene_decomp::probability::ProbabilityMap;
use serde::{Deserialize, Serialize};

use super::Trainer;
use super::agreement::Agreement;
use super::cameras::Cameras;
use super::contested::Contested;
use crate::prepare::error::PrepareError;
use crate::prepare::mask_faults::MaskFaults;
use crate::prepare::{Frame, Prepared};
use crate::render::rays::FrozenScene;
use crate::run_folder::RunFolder;

/// Numbers of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Numbers {
    step: u32,
    rays: f32,
    rate_scale: f64,
    seconds: f64,
    object_adam_step: u32,
    background_adam_step: u32,
    /// What the tables were trained with: nodes, where a checkpoint is of a version that does not say.
    #[serde(default)]
    hash: Hash,
    #[serde(default)]
    contested: Contested,
    #[serde(default)]
    cameras: Cameras,
    /// None where a checkpoint is of a version that does not say.
    #[serde(default)]
    frame: Option<Frame>,
}

const FIELDS: &str = "fields.bpk";
const SHARPNESS: &str = "sharpness.bpk";
const OPTIMISER: &str = "optimiser.bpk";
const SHARPNESS_OPTIMISER: &str = "sharpness_optimiser.bpk";
const MOMENTS: [&str; 2] = ["object_moments.f32", "background_moments.f32"];
const OCCUPANCY: [&str; 2] = ["object_occupancy.f32", "background_occupancy.f32"];
const VOTES: [&str; 2] = ["object_votes.f32", "votes.f32"];
const MAP: &str = "probability.f32";
const AGREEMENT: &str = "agreement.f32";
const NUMBERS: &str = "numbers.json";
const MASK_FAULTS: &str = "mask_faults.json";

/// The step that a run goes on from.
///
/// # Errors
/// When there is no checkpoint, or it cannot be read.
pub fn step_of(run: &RunFolder) -> anyhow::Result<u32> {
    Ok(numbers_in(&folder_of(run))?.step)
}

/// The box that a run lives in; none where its checkpoint does not say.
///
/// It is not to be found anew: masks may have been mended since, and versions look for it in other ways.
///
/// # Errors
/// When there is no checkpoint, or it cannot be read.
pub fn frame_of(run: &RunFolder) -> anyhow::Result<Option<Frame>> {
    Ok(numbers_in(&folder_of(run))?.frame)
}

/// Where a run's checkpoint is.
fn folder_of(run: &RunFolder) -> PathBuf {
    let folder = run.checkpoint_dir();
    if folder.exists() {
        return folder;
    }
    // A run killed between the two renames of `save`.
    folder.with_extension("old")
}

fn numbers_in(folder: &Path) -> anyhow::Result<Numbers> {
    let path = folder.join(NUMBERS);
    let text = fs::read(&path).map_err(|e| unusable(path.clone(), &e))?;
    Ok(serde_json::from_slice(&text).map_err(|e| unusable(path, &e))?)
}

impl Trainer {
    /// The scene as it is now, for rendering.
    #[must_use]
    pub fn freeze(&self) -> FrozenScene {
        let config = self.config().clone();
        let levels = self.context.object_layout.levels.len();
        let schedule = super::schedule::at(&config, self.step, levels);
        FrozenScene {
            fields: self.fetch_fields(schedule),
            grids: (*self.grids).clone(),
            map: (*self.map).clone(),
            step: self.step,
            config,
        }
    }

    /// Writes `checkpoint/`: into a new folder first, which then takes the old one's place.
    ///
    /// `seconds` is the training time so far.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, run: &RunFolder, seconds: f64) -> anyhow::Result<()> {
        let target = run.checkpoint_dir();
        let fresh = target.with_extension("new");
        let _ = fs::remove_dir_all(&fresh);
        self.write_into(&fresh, seconds).inspect_err(|_| {
            // Half of a checkpoint is of no use, and takes the room that the rest of the run needs to go on.
            let _ = fs::remove_dir_all(&fresh);
        })?;
        let old = target.with_extension("old");
        let _ = fs::remove_dir_all(&old);
        if target.exists() {
            fs::rename(&target, &old).map_err(|e| unwritable(&target, &e))?;
        }
        fs::rename(&fresh, &target).map_err(|e| unwritable(&target, &e))?;
        let _ = fs::remove_dir_all(&old);
        Ok(())
    }

    /// Writes the files of a checkpoint into a new folder, and has the system write them to the disk.
    fn write_into(&self, fresh: &Path, seconds: f64) -> anyhow::Result<()> {
        fs::create_dir_all(fresh).map_err(|e| unwritable(fresh, &e))?;
        let failed = |path: &Path, e: &dyn std::fmt::Display| unwritable(path, e);
        let path = |name: &str| fresh.join(name);
        self.scene
            .clone()
            .into_record()
            .save(path(FIELDS))
            .map_err(|e| failed(&path(FIELDS), &e))?;
        self.sharpness
            .clone()
            .into_record()
            .save(path(SHARPNESS))
            .map_err(|e| failed(&path(SHARPNESS), &e))?;
        self.optimiser
            .save(&path(OPTIMISER))
            .map_err(|e| failed(&path(OPTIMISER), &e))?;
        self.sharpness_optimiser
            .save(&path(SHARPNESS_OPTIMISER))
            .map_err(|e| failed(&path(SHARPNESS_OPTIMISER), &e))?;
        for (name, adam) in MOMENTS
            .iter()
            .zip([&self.object_adam, &self.background_adam])
        {
            write_floats(&path(name), &adam.state())?;
        }
        for (name, grid) in OCCUPANCY
            .iter()
            .zip([&self.grids.object, &self.grids.background])
        {
            write_floats(&path(name), grid.values())?;
        }
        for (name, votes) in VOTES.iter().zip(self.votes.values()) {
            write_floats(&path(name), votes)?;
        }
        write_floats(&path(MAP), self.map.values())?;
        write_floats(&path(AGREEMENT), &self.agreement.values())?;
        let numbers = Numbers {
            step: self.step,
            rays: self.rays,
            rate_scale: self.rate_scale,
            seconds,
            object_adam_step: self.object_adam.steps(),
            background_adam_step: self.background_adam.steps(),
            hash: self.config().model.hash,
            contested: self.contested.clone(),
            cameras: self.cameras.clone(),
            frame: Some(self.frame),
        };
        let faults = serde_json::to_vec(&self.mask_faults)?;
        fs::write(path(MASK_FAULTS), faults).map_err(|e| unwritable(&path(MASK_FAULTS), &e))?;
        let text = serde_json::to_vec_pretty(&numbers)?;
        fs::write(path(NUMBERS), text).map_err(|e| unwritable(&path(NUMBERS), &e))?;
        // What took the old one's place without being on the disk yet would be lost with it.
        Ok(sync_folder(fresh)?)
    }

    /// Goes back to the run's checkpoint; returns the seconds trained until then.
    ///
    /// # Errors
    /// When there is none, or one of another model.
    pub fn load(&mut self, run: &RunFolder) -> anyhow::Result<f64> {
        let folder = folder_of(run);
        let path = |name: &str| folder.join(name);
        let numbers = numbers_in(&folder)?;
        let text = fs::read(path(MASK_FAULTS)).map_err(|e| unusable(path(MASK_FAULTS), &e))?;
        let faults: MaskFaults =
            serde_json::from_slice(&text).map_err(|e| unusable(path(MASK_FAULTS), &e))?;
        let record = ModuleRecord::load(path(FIELDS)).map_err(|e| unusable(path(FIELDS), &e))?;
        let scene = self.scene.clone().try_load_record(record);
        self.scene = scene.map_err(|e| unusable(path(FIELDS), &e))?;
        let record =
            ModuleRecord::load(path(SHARPNESS)).map_err(|e| unusable(path(SHARPNESS), &e))?;
        let sharpness = self.sharpness.clone().try_load_record(record);
        self.sharpness = sharpness.map_err(|e| unusable(path(SHARPNESS), &e))?;
        self.optimiser
            .load(&path(OPTIMISER))
            .map_err(|e| unusable(path(OPTIMISER), &e))?;
        self.sharpness_optimiser
            .load(&path(SHARPNESS_OPTIMISER))
            .map_err(|e| unusable(path(SHARPNESS_OPTIMISER), &e))?;
        self.object_adam
            .restore(&read_floats(&path(MOMENTS[0]))?, numbers.object_adam_step)
            .map_err(|e| unusable(path(MOMENTS[0]), &e))?;
        self.background_adam
            .restore(
                &read_floats(&path(MOMENTS[1]))?,
                numbers.background_adam_step,
            )
            .map_err(|e| unusable(path(MOMENTS[1]), &e))?;
        let misfit = |name: &str| PrepareError::Checkpoint {
            path: path(name),
            what: "it has more or fewer values than this model; it is damaged, or of another one"
                .to_owned(),
        };
        if numbers.hash != self.config().model.hash {
            return Err(PrepareError::Checkpoint {
                path: folder,
                what: "its tables were trained with another model.hash".to_owned(),
            }
            .into());
        }
        let resolution = self.map.resolution();
        let [object, total] = [read_floats(&path(VOTES[0]))?, read_floats(&path(VOTES[1]))?];
        self.votes =
            SurfaceVotes::from_values(resolution, object, total).ok_or_else(|| misfit(VOTES[0]))?;
        let views = self.agreement.views();
        let agreement = read_floats(&path(AGREEMENT))?;
        self.agreement =
            Agreement::from_values(views, &agreement).ok_or_else(|| misfit(AGREEMENT))?;
        let map = read_floats(&path(MAP))?;
        if map.len() != resolution.pow(3) {
            return Err(misfit(MAP).into());
        }
        self.follow(ProbabilityMap::new(resolution, map));
        Arc::make_mut(&mut self.grids)
            .restore(
                &read_floats(&path(OCCUPANCY[0]))?,
                &read_floats(&path(OCCUPANCY[1]))?,
            )
            .map_err(|what| PrepareError::Checkpoint {
                path: folder.clone(),
                what,
            })?;
        self.step = numbers.step;
        self.rays = numbers.rays;
        self.mask_faults = faults;
        self.contested = numbers.contested;
        self.cameras = numbers.cameras;
        self.rate_scale = numbers.rate_scale;
        self.outlook.forget();
        self.ahead.forget();
        Ok(numbers.seconds)
    }

    /// After a step that gave no number: back to the checkpoint, or to the start where there is
    /// none yet, at half the learning rates.
    ///
    /// # Errors
    /// When the checkpoint cannot be read.
    pub fn recover(&mut self, run: &RunFolder, data: &Prepared) -> anyhow::Result<()> {
        let (scale, faults) = (self.rate_scale, self.mask_faults.clone());
        let contrasts = self.mask_contrasts.clone();
        let cameras = self.cameras.clone();
        if run.has_checkpoint() {
            self.load(run)?;
        } else {
            *self = Self::new(&self.config().clone(), data)?;
        }
        self.rate_scale = 0.5 * scale;
        self.mask_contrasts = contrasts;
        // Cameras and masks stay as they have been corrected.
        self.cameras = cameras;
        self.mask_faults = faults;
        Ok(())
    }
}

fn unwritable(path: &Path, error: &dyn std::fmt::Display) -> PrepareError {
    PrepareError::Scene(format!(
        "{}: the checkpoint could not be written ({error}); make room and go on with --resume, or choose another --out",
        path.display()
    ))
}

/// Has the system write a folder and the files in it to the disk, so that they outlive a crash of the
/// machine.
fn sync_folder(folder: &Path) -> Result<(), PrepareError> {
    for entry in fs::read_dir(folder).map_err(|e| unwritable(folder, &e))? {
        let path = entry.map_err(|e| unwritable(folder, &e))?.path();
        // To be written to: Windows refuses it otherwise.
        let file = fs::OpenOptions::new().write(true).open(&path);
        file.and_then(|file| file.sync_all())
            .map_err(|e| unwritable(&path, &e))?;
    }
    // Their names. Some file systems cannot, and then need not be asked.
    #[cfg(unix)]
    let _ = fs::File::open(folder).and_then(|folder| folder.sync_all());
    Ok(())
}

fn unusable(path: PathBuf, error: &dyn std::fmt::Display) -> PrepareError {
    PrepareError::Checkpoint {
        what: format!("this checkpoint cannot be used ({error})"),
        path,
    }
}

fn write_floats(path: &Path, values: &[f32]) -> Result<(), PrepareError> {
    let write = || -> std::io::Result<()> {
        let mut file = std::io::BufWriter::new(fs::File::create(path)?);
        for chunk in values.chunks(4096) {
            let bytes: Vec<u8> = chunk.iter().flat_map(|v| v.to_le_bytes()).collect();
            file.write_all(&bytes)?;
        }
        file.flush()
    };
    write().map_err(|e| unwritable(path, &e))
}

fn read_floats(path: &Path) -> Result<Vec<f32>, PrepareError> {
    let bytes = fs::read(path).map_err(|e| unusable(path.to_path_buf(), &e))?;
    Ok(bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect())
}
