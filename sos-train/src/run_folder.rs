//! The folder of a run: where things lie in it, and how they get there.
//!
//! Nothing half-written is ever found in it: every file is written under a temporary name beside
//! its place and renamed when it is complete. A folder is not touched before there is something to
//! write, so that input that turns out to be unusable costs no earlier result; then, with
//! [`Existing::Replace`], what an earlier run wrote goes first. Files of other origin stay.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Folders of one picture per view, with the ending of the files in them.
const VIEW_FOLDERS: [(&str, &str); 6] = [
    ("alpha", "png"),
    ("foreground", "png"),
    ("background", "png"),
    ("background_seen", "png"),
    ("normal", "png"),
    ("depth", "exr"),
];
const CHECKPOINT: &str = "checkpoint";
const CONFIG: &str = "config.toml";
const LOG: &str = "log.jsonl";
/// Files at the top of a run.
const FILES: [&str; 6] = [CONFIG, LOG, "mesh.ply", "metrics.json", "report.html", "preview.png"];
/// Start of the names of files that are being written.
const PARTIAL: &str = ".sos-partial-";

/// What is wrong with a run's folder.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}; {}", path.display(), remedy(source))]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// There is a run already.
    #[error("{} already holds a run; add --resume to go on with it, --force to replace it, or choose another folder with --out", path.display())]
    Exists {
        /// The run's folder.
        path: PathBuf,
    },
    /// The folder is in use for something else.
    #[error("{} is not empty and holds no run, so nothing is written there; choose another folder with --out", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// The path leads to a file.
    #[error("{} is a file; a run needs a folder, choose another one with --out", path.display())]
    NotAFolder {
        /// The file.
        path: PathBuf,
    },
    /// There is no run to go on with.
    #[error("{} holds no run ({CONFIG} is missing); check the path, or start one without --resume", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// There is a run, but it was stopped before its first checkpoint.
    #[error("{} has no checkpoint yet, so there is nothing to go on from; start it again with --force", path.display())]
    NoCheckpoint {
        /// The run's folder.
        path: PathBuf,
    },
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "free some space and go on with --resume"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "choose a folder you may write to with --out"
        }
        _ => "check the path and the disk",
    }
}

impl RunError {
    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io { action, path: path.to_path_buf(), source }
    }
}

/// What to do with a run that is already there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Refuse.
    Keep,
    /// Remove what it wrote, as soon as there is something new to write.
    Replace,
}

/// The folder of one run. Clones are handles to the same folder.
#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
    /// What is still to be done before the first file is written.
    pending: Arc<Mutex<Option<Pending>>>,
}

#[derive(Debug)]
struct Pending {
    replace: bool,
    config: Option<String>,
}

impl RunFolder {
    /// A folder for a new run. It is created if it does not exist; apart from that nothing changes
    /// until the first file is written.
    ///
    /// # Errors
    /// [`RunError`] if a run is there and `existing` says to keep it, if the folder holds only
    /// other things, or if it cannot be written to.
    pub fn create(path: &Path, existing: Existing) -> Result<Self, RunError> {
        let mut replace = false;
        match fs::read_dir(path) {
            Ok(entries) => {
                let names: Vec<String> = entries
                    .flatten()
                    .map(|entry| entry.file_name().to_string_lossy().into_owned())
                    .filter(|name| !name.starts_with(PARTIAL))
                    .collect();
                if names.iter().any(|name| name == CONFIG || name == CHECKPOINT) {
                    if existing == Existing::Keep {
                        return Err(RunError::Exists { path: path.to_path_buf() });
                    }
                    replace = true;
                } else if !names.is_empty() {
                    return Err(RunError::Foreign { path: path.to_path_buf() });
                }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(_) if path.is_file() => {
                return Err(RunError::NotAFolder { path: path.to_path_buf() });
            }
            Err(source) => return Err(RunError::io("list", path, source)),
        }
        let run = Self {
            root: path.to_path_buf(),
            pending: Arc::new(Mutex::new(Some(Pending { replace, config: None }))),
        };
        run.probe()?;
        Ok(run)
    }

    /// The folder of a run that is there, to go on with it or to look at it.
    ///
    /// # Errors
    /// [`RunError::NoRun`] if there is none.
    pub fn open_existing(path: &Path) -> Result<Self, RunError> {
        if !path.join(CONFIG).is_file() {
            return Err(RunError::NoRun { path: path.to_path_buf() });
        }
        Ok(Self::open(path))
    }

    fn open(path: &Path) -> Self {
        Self { root: path.to_path_buf(), pending: Arc::default() }
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
        if let Some(config) = &pending.config {
            write_file(&self.config_path(), Durability::Disk, |out| {
                out.write_all(config.as_bytes())
            })?;
        }
        *slot = None;
        Ok(())
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

    /// Takes back what was written, after input that turned out to be unusable: nothing if nothing
    /// was begun. The folder goes too if it is empty then.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn abandon(&self, demo: bool) -> Result<(), RunError> {
        let begun = self.pending.lock().unwrap_or_else(PoisonError::into_inner).is_none();
        if begun {
            self.clear()?;
            if demo {
                remove_folder(&self.demo_scene_dir())?;
            }
        }
        // Refused for a folder with anything in it, which is the point.
        let _ = fs::remove_dir(&self.root);
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

    /// `checkpoint/`; while one is saved, `checkpoint.new/` and `checkpoint.old/` may lie beside it.
    #[must_use]
    pub fn checkpoint_dir(&self) -> PathBuf {
        self.root.join(CHECKPOINT)
    }

    /// `scene/`: the demo scene, in a run of the demo.
    #[must_use]
    pub fn demo_scene_dir(&self) -> PathBuf {
        self.root.join("scene")
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

    /// Writes a file in one piece: under another name first, then renamed. Folders on the way are
    /// created. The file survives a crash of the program.
    ///
    /// # Errors
    /// [`RunError::Io`] naming the file.
    pub fn write(
        &self,
        path: &Path,
        fill: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>,
    ) -> Result<(), RunError> {
        self.begin()?;
        write_file(path, Durability::Program, fill)
    }

    /// Like [`RunFolder::write`], and the file survives a crash of the machine too: for
    /// checkpoints.
    ///
    /// # Errors
    /// [`RunError::Io`] naming the file.
    pub fn write_durably(
        &self,
        path: &Path,
        fill: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>,
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
        let checkpoint = self.checkpoint_dir();
        for dir in [checkpoint.with_extension("old"), checkpoint.with_extension("new"), checkpoint] {
            remove_folder(&dir)?;
        }
        for entry in fs::read_dir(&self.root).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(PARTIAL) {
                remove_file(&entry.path())?;
            }
        }
        Ok(())
    }
}

/// What a finished file survives.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Durability {
    Program,
    Disk,
}

fn write_file(
    path: &Path,
    durability: Durability,
    fill: impl FnOnce(&mut BufWriter<&mut fs::File>) -> io::Result<()>,
) -> Result<(), RunError> {
    let fail = |e| RunError::io("write", path, e);
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(|e| RunError::io("create the folder", folder, e))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(PARTIAL);
    #[cfg(unix)]
    {
        // As for any new file: what the user's umask leaves of it, not the private 0600.
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(fail)?;
    let mut out = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    fill(&mut out).map_err(fail)?;
    out.flush().map_err(fail)?;
    drop(out);
    if durability == Durability::Disk {
        file.as_file().sync_all().map_err(fail)?;
    }
    file.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}

/// The path of a view's file below `folder`: as the photo, with another ending. Parts of the name
/// that would lead elsewhere are left out.
pub(crate) fn view_file(folder: &Path, photo: &str, ending: &str) -> PathBuf {
    let mut path = folder.to_path_buf();
    // COLMAP models made on Windows have backslashes.
    for part in Path::new(&photo.replace('\\', "/")).components() {
        if let Component::Normal(part) = part {
            path.push(part);
        }
    }
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(ending);
    path.set_file_name(name);
    path
}

fn remove_folder(path: &Path) -> Result<(), RunError> {
    match fs::remove_dir_all(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(RunError::io("remove", path, e)),
        _ => Ok(()),
    }
}

fn remove_file(path: &Path) -> Result<(), RunError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(RunError::io("remove", path, e)),
        _ => Ok(()),
    }
}

fn remove_pictures(folder: &Path, ending: &str) -> Result<(), RunError> {
    // A link leads out of the run.
    if folder.is_symlink() {
        return Ok(());
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let partial = entry.file_name().to_string_lossy().starts_with(PARTIAL);
        if path.is_dir() {
            remove_pictures(&path, ending)?;
        } else if partial || path.extension().is_some_and(|e| e == ending) {
            remove_file(&path)?;
        }
    }
    // Refused while something is left.
    let _ = fs::remove_dir(folder);
    Ok(())
}
