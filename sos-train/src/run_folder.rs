//! The folder of a run: where things lie in it, and how they get there.
//!
//! Nothing half-written is ever found in it: every file is written under a temporary name beside
//! its place and renamed when it is complete. A folder is not touched before there is something to
//! write, so that input that turns out to be unusable costs no earlier result; then, with
//! [`Existing::Replace`], what an earlier run wrote goes first. Files of other origin stay.

mod error;
mod files;
mod lock;
mod verdicts;

pub use draft_folder::Existing;
pub use error::RunError;
pub(crate) use files::{view_file, write_folder, write_whole};

use draft_folder::Durability;
use files::{
    PARTIAL, holds_pictures, remove_file, remove_folder, remove_made, remove_pictures, write_file,
};
use lock::{LOCK, Lock};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

const CAMERAS: &str = scene_export::CAMERAS;
/// Folders of one picture per view and of refined cameras, with the ending of the files in them.
const VIEW_FOLDERS: [(&str, &str); 9] = [
    ("alpha", "png"),
    ("foreground", "png"),
    ("background", "png"),
    ("background_seen", "png"),
    ("normal", "png"),
    ("depth", "exr"),
    ("found_masks", "png"),
    ("uncertainty", "png"),
    (CAMERAS, "bin"),
];
const CHECKPOINT: &str = "checkpoint";
const SCENE: &str = "scene";
const CONFIG: &str = "config.toml";
const LOG: &str = "log.jsonl";
/// Files at the top of a run.
const FILES: [&str; 6] = [
    CONFIG,
    LOG,
    "mesh.ply",
    "metrics.json",
    "report.html",
    "preview.png",
];

/// Folders of what `sos export` and `sos render` made of the results.
const MADE_FOLDERS: [&str; 2] = ["export", "render"];

/// The folder of one run. Clones are handles to the same folder.
#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
    /// Whether it was not there before.
    is_new: bool,
    /// What is still to be done before the first file is written.
    pending: Arc<Mutex<Option<Pending>>>,
    /// Of whoever makes the run, not of those who look at it.
    lock: Option<Arc<Lock>>,
}

#[derive(Debug)]
struct Pending {
    replace: bool,
    config: Option<String>,
}

impl RunFolder {
    /// A folder for a new run. It is created if it does not exist; apart from that nothing changes
    /// until the first file is written; then what an earlier run wrote is removed, if `existing` says to replace it.
    ///
    /// # Errors
    /// [`RunError`] if a run is there and `existing` says to keep it, if another process makes one, if the folder
    /// holds anything else than a scene that an earlier run has left, or if it cannot be written to.
    pub fn create(path: &Path, existing: Existing) -> Result<Self, RunError> {
        let mut replace = false;
        let mut is_new = false;
        match fs::read_dir(path) {
            Ok(entries) => {
                let names: Vec<String> = entries
                    .flatten()
                    .map(|entry| entry.file_name().to_string_lossy().into_owned())
                    .filter(|name| !name.starts_with(PARTIAL) && name != LOCK)
                    .collect();
                if names
                    .iter()
                    .any(|name| name == CONFIG || name == CHECKPOINT)
                {
                    if existing == Existing::Keep {
                        return Err(RunError::Exists {
                            path: path.to_path_buf(),
                        });
                    }
                    replace = true;
                } else if names.iter().any(|name| name != SCENE) {
                    return Err(RunError::Foreign {
                        path: path.to_path_buf(),
                    });
                }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => is_new = true,
            Err(_) if path.is_file() => {
                return Err(RunError::NotAFolder {
                    path: path.to_path_buf(),
                });
            }
            Err(source) => return Err(RunError::io("list", path, source)),
        }
        let run = Self {
            root: path.to_path_buf(),
            is_new,
            pending: Arc::new(Mutex::new(Some(Pending {
                replace,
                config: None,
            }))),
            lock: None,
        };
        run.probe()?;
        run.locked()
    }

    /// The folder of a run that is there, to go on with it.
    ///
    /// # Errors
    /// [`RunError::NoRun`] if there is none, [`RunError::Busy`] while another process makes it, [`RunError::Io`] if its scene
    /// cannot be put back in its place.
    pub fn go_on(path: &Path) -> Result<Self, RunError> {
        let run = Self::open_existing(path)?.locked()?;
        // Of a program that was killed before the run that was to replace this one began.
        run.bring_back_scene()?;
        Ok(run)
    }

    fn locked(self) -> Result<Self, RunError> {
        let lock = Lock::take(&self.root)?.map(Arc::new);
        Ok(Self { lock, ..self })
    }

    /// The folder of a run that is there, to look at it.
    ///
    /// # Errors
    /// [`RunError::NoRun`] if there is none.
    pub fn open_existing(path: &Path) -> Result<Self, RunError> {
        if !path.join(CONFIG).is_file() {
            return Err(RunError::NoRun {
                path: path.to_path_buf(),
            });
        }
        Ok(Self::open(path))
    }

    fn open(path: &Path) -> Self {
        Self {
            root: path.to_path_buf(),
            is_new: false,
            pending: Arc::default(),
            lock: None,
        }
    }

    /// States the text of `config.toml`, which is the first file to be written.
    pub fn set_config(&self, text: String) {
        let mut pending = self.pending.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pending) = pending.as_mut() {
            pending.config = Some(text);
        }
    }

    /// Makes the folder this run's: removes what an earlier one wrote, writes `config.toml`. Every
    /// writer of this crate calls it; call it yourself before writing by other means. Only the
    /// first call does anything.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn begin(&self) -> Result<(), RunError> {
        let mut slot = self.pending.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(pending) = slot.as_ref() else {
            return Ok(());
        };
        if pending.replace {
            self.clear()?;
        }
        remove_folder(&self.earlier_scene_dir())?;
        if let Some(config) = &pending.config {
            write_file(&self.config_path(), Durability::Disk, |out| {
                out.write_all(config.as_bytes())
            })?;
        }
        *slot = None;
        Ok(())
    }

    /// Whether anything of this run has been written, so that results of an earlier one are gone.
    #[must_use]
    pub(crate) fn has_begun(&self) -> bool {
        self.pending
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_none()
    }

    /// Whether there is a checkpoint to go on from.
    #[must_use]
    pub fn has_checkpoint(&self) -> bool {
        // A run that was killed while it saved may have the old one only.
        let dir = self.checkpoint_dir();
        [dir.with_extension("old"), dir]
            .iter()
            .any(|dir| fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some()))
    }

    /// Takes back what was written, after input that turned out to be unusable: results if any were
    /// begun, and the scene if the run made it, in whose place that of an earlier run comes back. The folder goes too if the
    /// run made it and it is empty then.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn abandon(&self, owns_scene: bool) -> Result<(), RunError> {
        if self.has_begun() {
            self.clear()?;
        }
        if owns_scene {
            remove_folder(&self.scene_dir())?;
        }
        self.bring_back_scene()?;
        if let Some(lock) = &self.lock {
            lock.remove_file();
        }
        // One that was there may be the one that a shell is in.
        if self.is_new {
            // Refused for a folder with anything in it, which is the point.
            let _ = fs::remove_dir(&self.root);
        }
        Ok(())
    }

    /// The run's folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `alpha/`: mattes, 16-bit grey.
    #[must_use]
    pub fn alpha_dir(&self) -> PathBuf {
        self.root.join("alpha")
    }

    /// `foreground/`: cut-outs, RGBA with straight alpha.
    #[must_use]
    pub fn foreground_dir(&self) -> PathBuf {
        self.root.join("foreground")
    }

    /// `background/`: plates, RGB.
    #[must_use]
    pub fn background_dir(&self) -> PathBuf {
        self.root.join("background")
    }

    /// `background_seen/`: how many views saw what a plate shows, 8-bit grey.
    #[must_use]
    pub fn background_seen_dir(&self) -> PathBuf {
        self.root.join("background_seen")
    }

    /// `normal/`: world normals as RGB.
    #[must_use]
    pub fn normal_dir(&self) -> PathBuf {
        self.root.join("normal")
    }

    /// `depth/`: depth in scene units, OpenEXR.
    #[must_use]
    pub fn depth_dir(&self) -> PathBuf {
        self.root.join("depth")
    }

    /// `found_masks/`: rough masks that the run found by itself, 8-bit grey; only where it had to.
    #[must_use]
    pub fn found_masks_dir(&self) -> PathBuf {
        self.root.join("found_masks")
    }

    /// Whether the run found its masks itself. A file that somebody else left in their folder does not count.
    #[must_use]
    pub fn has_found_masks(&self) -> bool {
        holds_pictures(&self.found_masks_dir(), "png")
    }

    /// `uncertainty/`: where mattes should not be relied on, 8-bit grey.
    #[must_use]
    pub fn uncertainty_dir(&self) -> PathBuf {
        self.root.join("uncertainty")
    }

    /// `cameras/`: a COLMAP model with the poses that the run refined; only where it did.
    #[must_use]
    pub fn cameras_dir(&self) -> PathBuf {
        self.root.join(CAMERAS)
    }

    /// `checkpoint/`; while one is saved, `checkpoint.new/` and `checkpoint.old/` may lie beside it.
    #[must_use]
    pub fn checkpoint_dir(&self) -> PathBuf {
        self.root.join(CHECKPOINT)
    }

    /// `scene/`: the scene, where the run made it itself: the demo, and what was imported.
    #[must_use]
    pub fn scene_dir(&self) -> PathBuf {
        Self::scene_in(&self.root)
    }

    /// [`RunFolder::scene_dir`] of the run at a path.
    pub(crate) fn scene_in(root: &Path) -> PathBuf {
        root.join(SCENE)
    }

    /// `mesh.ply`.
    #[must_use]
    pub fn mesh_path(&self) -> PathBuf {
        self.root.join("mesh.ply")
    }

    /// `config.toml`.
    #[must_use]
    pub fn config_path(&self) -> PathBuf {
        self.root.join(CONFIG)
    }

    /// `log.jsonl`.
    #[must_use]
    pub fn log_path(&self) -> PathBuf {
        self.root.join(LOG)
    }

    /// `metrics.json`.
    #[must_use]
    pub fn metrics_path(&self) -> PathBuf {
        self.root.join("metrics.json")
    }

    /// `report.html`.
    #[must_use]
    pub fn report_path(&self) -> PathBuf {
        self.root.join("report.html")
    }

    /// `preview.png`: what the run looks like at the moment.
    #[must_use]
    pub fn preview_path(&self) -> PathBuf {
        self.root.join("preview.png")
    }

    /// Puts a scene that was made elsewhere on the same disk into [`RunFolder::scene_dir`], in place
    /// of one that an earlier run made there, which goes with that run's results: with the first file that is written.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn take_scene(&self, made: &Path) -> Result<(), RunError> {
        let (dir, earlier) = (self.scene_dir(), self.earlier_scene_dir());
        remove_folder(&earlier)?;
        if dir.is_dir() {
            fs::rename(&dir, &earlier).map_err(|e| RunError::io("move away", &dir, e))?;
        }
        fs::rename(made, &dir).map_err(|e| RunError::io("create the folder", &dir, e))
    }

    /// Puts the scene of an earlier run, in whose place another was put, back there, if this run has not begun.
    fn bring_back_scene(&self) -> Result<(), RunError> {
        let (dir, earlier) = (self.scene_dir(), self.earlier_scene_dir());
        if earlier.is_dir() {
            remove_folder(&dir)?;
            fs::rename(&earlier, &dir).map_err(|e| RunError::io("move back", &earlier, e))?;
        }
        Ok(())
    }

    /// Where an earlier run's scene is until this run has begun.
    fn earlier_scene_dir(&self) -> PathBuf {
        self.root.join(format!("{PARTIAL}earlier-scene"))
    }

    /// A name in the run's folder for a scene that is being made; nothing is there.
    ///
    /// # Errors
    /// [`RunError::Io`] if what an earlier attempt left cannot be removed.
    pub(crate) fn fresh_scene_dir(&self) -> Result<PathBuf, RunError> {
        let dir = self.root.join(format!("{PARTIAL}scene"));
        remove_folder(&dir)?;
        Ok(dir)
    }

    /// Writes a file in one piece: under another name first, then renamed. Folders on the way are
    /// created. The file survives a crash of the program.
    ///
    /// # Errors
    /// [`RunError::Io`] naming the file.
    pub fn write(
        &self,
        path: &Path,
        fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), RunError> {
        self.begin()?;
        write_file(path, Durability::Program, fill)
    }

    /// Like [`RunFolder::write`], and what is in the file survives a crash of the machine too: for the
    /// record that a run is known by.
    ///
    /// # Errors
    /// [`RunError::Io`] naming the file.
    pub fn write_durably(
        &self,
        path: &Path,
        fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), RunError> {
        self.begin()?;
        write_file(path, Durability::Disk, fill)
    }

    /// Creates the folder and a file in it, to find out whether that is allowed.
    fn probe(&self) -> Result<(), RunError> {
        fs::create_dir_all(&self.root)
            .map_err(|e| RunError::io("create the folder", &self.root, e))?;
        tempfile::Builder::new()
            .prefix(PARTIAL)
            .tempfile_in(&self.root)
            .map(drop)
            .map_err(|e| RunError::io("write to the folder", &self.root, e))
    }

    /// Removes what a run writes. In its own folders these are the files with its own endings;
    /// anything else stays, as do folders that are not empty then.
    fn clear(&self) -> Result<(), RunError> {
        // The record goes first: what is left by a crash is then no run that looks complete.
        for name in FILES {
            remove_file(&self.root.join(name))?;
        }
        for (folder, ending) in VIEW_FOLDERS {
            remove_pictures(&self.root.join(folder), ending)?;
        }
        // Beside other results they would pass for being made of those.
        for folder in MADE_FOLDERS {
            remove_made(&self.root.join(folder))?;
        }
        let checkpoint = self.checkpoint_dir();
        for dir in [
            checkpoint.with_extension("old"),
            checkpoint.with_extension("new"),
            checkpoint,
        ] {
            remove_folder(&dir)?;
        }
        for entry in fs::read_dir(&self.root).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(PARTIAL) {
                if entry.path().is_dir() {
                    remove_folder(&entry.path())?;
                } else {
                    remove_file(&entry.path())?;
                }
            }
        }
        Ok(())
    }
}
