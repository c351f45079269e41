//! A finished run's folder, as it lies on disk: what is in it, and the scene it was made from.

use crate::error::ExportError;
use crate::picture::{Cutout, Matte};
use image::{DynamicImage, ImageReader};
use io_colmap::{Camera, ColmapError, Listing, Scene, View, decode_photo};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Folder of a run that refined its cameras: a COLMAP model with their poses.
pub const CAMERAS: &str = "cameras";

/// A run with at least one matte.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) root: PathBuf,
    /// One per matte: its path below `alpha/` without ending, with `/` between folders, sorted.
    pub(crate) keys: Vec<String>,
    /// What of `alpha/` cannot be read; names are in `keys`.
    unread: Listing,
}

/// A photo of the scene with the run's matte of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posed<'a> {
    pub(crate) view: &'a View,
    pub(crate) camera: &'a Camera,
    pub(crate) key: &'a str,
}

/// The part of `config.toml` that is read here.
#[derive(Debug, serde::Deserialize)]
struct Config {
    input: Option<Input>,
}

#[derive(Debug, serde::Deserialize)]
struct Input {
    scene: Option<PathBuf>,
    #[serde(default)]
    demo: bool,
    imported_from: Option<PathBuf>,
}

impl Run {
    pub(crate) fn open(root: &Path) -> Result<Self, ExportError> {
        if !root.join("config.toml").is_file() {
            return Err(ExportError::bad(
                root,
                "there is no run in it (config.toml is missing)",
                "give the folder that sos train wrote",
            ));
        }
        let alpha = root.join("alpha");
        let mut listing = Listing::default();
        if alpha.is_dir() {
            collect(&alpha, "", &mut listing).map_err(|e| ExportError::io("list", &alpha, e))?;
        }
        listing.names.sort();
        listing.closed.sort_by(|a, b| a.0.cmp(&b.0));
        let run = Self {
            root: root.to_path_buf(),
            keys: std::mem::take(&mut listing.names),
            unread: listing,
        };
        if run.keys.is_empty() {
            return Err(run.lacks_matte(
                &alpha,
                "there are no mattes in it yet",
                |_| true,
                format!("let the run come to its end: {}", resumed(root)),
            ));
        }
        Ok(run)
    }

    /// What of the mattes is left out, a sentence each.
    pub(crate) fn left_out(&self) -> Vec<String> {
        self.unread.notes("mattes")
    }

    /// That the run has not come to its end, where its log shows so.
    pub(crate) fn unfinished(&self) -> Option<String> {
        (has_ended(&self.root) == Some(false)).then(|| {
            format!(
                "the run has not come to its end: pictures may be missing, or of an earlier state of it; have it go on with: {}",
                resumed(&self.root)
            )
        })
    }

    /// There is no matte at `path`. Where a sub-folder that cannot be read `may_hold` it, that is the reason.
    fn lacks_matte(
        &self,
        path: &Path,
        what: impl Into<String>,
        may_hold: impl Fn(&Path) -> bool,
        remedy: impl Into<String>,
    ) -> ExportError {
        let what = what.into();
        let mut closed = self.unread.closed.iter();
        match closed.find(|(folder, _)| may_hold(folder)) {
            Some((folder, error)) => {
                let what = format!(
                    "{what}, and the sub-folder {} cannot be read ({error})",
                    folder.display()
                );
                ExportError::bad(path, what, io_colmap::remedy(error))
            }
            None => ExportError::bad(path, what, remedy),
        }
    }

    /// Where a view's picture lies.
    pub(crate) fn picture_path(&self, folder: &str, key: &str, ending: &str) -> PathBuf {
        self.root.join(folder).join(format!("{key}.{ending}"))
    }

    pub(crate) fn matte(&self, key: &str) -> Result<Matte, ExportError> {
        let grey = self
            .open_picture(&self.picture_path("alpha", key, "png"))?
            .into_luma16();
        Ok(Matte {
            width: grey.width(),
            height: grey.height(),
            values: grey.into_raw(),
        })
    }

    /// A view's matte, which must have its camera's size.
    pub(crate) fn matte_of(&self, posed: Posed<'_>) -> Result<Matte, ExportError> {
        let matte = self.matte(posed.key)?;
        let camera = (posed.camera.width, posed.camera.height);
        if (matte.width, matte.height) == camera {
            return Ok(matte);
        }
        Err(ExportError::bad(
            &self.picture_path("alpha", posed.key, "png"),
            format!(
                "the matte is {}x{} but the photo {:?} is {}x{}",
                matte.width, matte.height, posed.view.name, camera.0, camera.1
            ),
            "give the scene that the run was made from with --scene",
        ))
    }

    /// A view's colours of the object with its matte.
    pub(crate) fn cutout(&self, key: &str) -> Result<Cutout, ExportError> {
        let alpha = self.matte(key)?;
        let colours = self.rgb("foreground", key, (alpha.width, alpha.height))?;
        Ok(Cutout { alpha, colours })
    }

    /// An RGB picture of a view, `[height * width]`; alpha is left out.
    pub(crate) fn rgb(
        &self,
        folder: &str,
        key: &str,
        size: (u32, u32),
    ) -> Result<Vec<[u8; 3]>, ExportError> {
        let path = self.picture_path(folder, key, "png");
        let picture = self.open_picture(&path)?;
        self.check_size(&path, (picture.width(), picture.height()), size)?;
        Ok(match picture {
            DynamicImage::ImageRgba8(rgba) => rgba.pixels().map(|p| [p[0], p[1], p[2]]).collect(),
            other => other.into_rgb8().pixels().map(|p| p.0).collect(),
        })
    }

    /// All pictures of a view have one size.
    pub(crate) fn check_size(
        &self,
        path: &Path,
        found: (u32, u32),
        wanted: (u32, u32),
    ) -> Result<(), ExportError> {
        if found == wanted {
            return Ok(());
        }
        Err(ExportError::bad(
            path,
            format!(
                "it is {}x{} but the matte is {}x{}",
                found.0, found.1, wanted.0, wanted.1
            ),
            format!(
                "the files are of different runs; make the run again: {}",
                repeated(&self.root)
            ),
        ))
    }

    /// A picture that the run wrote.
    fn open_picture(&self, path: &Path) -> Result<DynamicImage, ExportError> {
        let reader = ImageReader::open(path)
            .and_then(ImageReader::with_guessed_format)
            .map_err(|e| ExportError::io("read", path, e))?;
        let decoder = reader
            .into_decoder()
            .map_err(|e| self.damaged(path, format!("the picture cannot be read ({e})")))?;
        // As large as photos may be: `image` alone stops at half a gigabyte.
        decode_photo(path, decoder).map_err(|error| match error {
            ColmapError::Scene { what, .. } => self.damaged(path, what),
            other => other.into(),
        })
    }

    /// A file of the run that cannot be used.
    pub(crate) fn damaged(&self, path: &Path, what: impl Into<String>) -> ExportError {
        let remedy = format!("make the run's results again: {}", resumed(&self.root));
        ExportError::bad(path, what, remedy)
    }

    /// The COLMAP scene that the run was made from, with the poses that the run refined, if it did. What was decided
    /// about the scene moves into `notes`.
    pub(crate) fn scene(
        &self,
        stated: Option<&Path>,
        notes: &mut Vec<String>,
    ) -> Result<Scene, ExportError> {
        let mut scene = self.scene_as_given(stated)?;
        scene.take_poses(&self.root.join(CAMERAS))?;
        notes.append(&mut scene.notes);
        Ok(scene)
    }

    /// The scene: where it is stated to be, else in the run's own folder, if the run made it, else where `config.toml`
    /// says.
    fn scene_as_given(&self, stated: Option<&Path>) -> Result<Scene, ExportError> {
        if let Some(folder) = stated {
            return Ok(Scene::open(folder)?);
        }
        let path = self.root.join("config.toml");
        let text = fs::read_to_string(&path).map_err(|e| ExportError::io("read", &path, e))?;
        let config: Config = toml::from_str(&text).map_err(|e| {
            ExportError::bad(
                &path,
                format!("this is no run's configuration ({})", e.message()),
                "name the run's scene with --scene",
            )
        })?;
        // Such a run may have been moved, with its scene. One that an earlier run left there is not of these results.
        let own = self.root.join("scene");
        let made = |input: &Input| input.demo || input.imported_from.is_some();
        if config.input.as_ref().is_some_and(made) && Scene::has_model(&own) {
            return Ok(Scene::open(&own)?);
        }
        match config.input.and_then(|input| input.scene) {
            Some(scene) if Scene::has_model(&scene) => Ok(Scene::open(&scene)?),
            Some(scene) => Err(ExportError::bad(
                &scene,
                "the run was made from the COLMAP scene that was here, and there is none now",
                "say where it is with --scene",
            )),
            None => Err(ExportError::bad(
                &path,
                "it does not say which scene the run was made from",
                "say where it is with --scene",
            )),
        }
    }

    /// Every photo of the scene with its matte, in the model's order, which is by name.
    pub(crate) fn posed<'a>(&'a self, scene: &'a Scene) -> Result<Vec<Posed<'a>>, ExportError> {
        let by_key: BTreeMap<&str, ()> = self.keys.iter().map(|key| (key.as_str(), ())).collect();
        let mut taken: BTreeMap<&str, &str> = BTreeMap::new();
        let views = &scene.model.views;
        views
            .iter()
            .map(|view| {
                let wanted = key_of(&view.name);
                let camera = scene.model.cameras.get(&view.camera_id);
                let key = by_key.get_key_value(wanted.as_str());
                let (Some((key, ())), Some(camera)) = (key, camera) else {
                    let path = self.picture_path("alpha", &wanted, "png");
                    return Err(self.lacks_matte(
                        &path,
                        format!(
                            "the run has no matte of {:?}, one of the {} photos in {}",
                            view.name,
                            views.len(),
                            scene.root.display()
                        ),
                        |folder| path.starts_with(folder),
                        "give the scene that the run was made from with --scene",
                    ));
                };
                if let Some(first) = taken.insert(key, &view.name) {
                    return Err(ExportError::bad(
                        &scene.image_path(view),
                        format!("this photo and {first:?} differ only in their ending"),
                        "rename one of them in the photo folder and the model",
                    ));
                }
                Ok(Posed { view, camera, key })
            })
            .collect()
    }
}

/// The name under which a photo's pictures lie in a run: without its ending, and without parts that
/// would lead elsewhere.
#[must_use]
pub fn key_of(photo: &str) -> String {
    // COLMAP models made on Windows have backslashes.
    let clean = photo.replace('\\', "/");
    let mut parts: Vec<String> = Path::new(&clean)
        .components()
        .filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        })
        .collect();
    if let Some(last) = parts.last_mut() {
        let stem = Path::new(last.as_str()).file_stem();
        *last = stem.unwrap_or_default().to_string_lossy().into_owned();
    }
    parts.join("/")
}

/// Whether a run has come to its end, as its log says; `None` without one.
#[must_use]
pub fn has_ended(root: &Path) -> Option<bool> {
    let log = fs::read_to_string(root.join("log.jsonl")).ok()?;
    let is_end = |line: &str| {
        serde_json::from_str::<serde_json::Value>(line)
            .is_ok_and(|line| line.get("event").is_some_and(|event| event == "end"))
    };
    Some(log.lines().any(is_end))
}

/// The command that goes on with a run, and makes its results again where it is at its end. Without
/// the folder it would go on with another run.
pub(crate) fn resumed(root: &Path) -> String {
    format!("sos train --resume --out {}", quoted(root))
}

/// The command that makes a run again from its start. Without its configuration it would train on
/// another scene.
fn repeated(root: &Path) -> String {
    let config = quoted(&root.join("config.toml"));
    format!("sos train --config {config} --out {} --force", quoted(root))
}

/// A path that can be pasted into a shell.
#[must_use]
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    // A backslash parts folders on Windows, and takes the next character's meaning elsewhere.
    let plain = if cfg!(windows) {
        "/\\._-:~+,@"
    } else {
        "/._-:~+,@"
    };
    let is_plain = |c: char| c.is_alphanumeric() || plain.contains(c);
    if !text.is_empty() && !text.starts_with('~') && text.chars().all(is_plain) {
        text
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// The PNG files below a folder, and its sub-folders that cannot be read, whose files may not be wanted.
fn collect(folder: &Path, prefix: &str, listing: &mut Listing) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let path = entry.path();
        if path.is_dir() {
            // A link could lead back here.
            if !path.is_symlink()
                && let Err(error) = collect(&path, &format!("{prefix}{name}/"), listing)
            {
                listing.closed.push((path, error));
            }
        } else if let Some(stem) = name.strip_suffix(".png") {
            listing.names.push(format!("{prefix}{stem}"));
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::io::Write as _;

    #[test]
    fn pictures_are_read_back_as_large_as_photos_may_be() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        fs::write(root.join("config.toml"), "").unwrap();
        fs::create_dir(root.join("alpha")).unwrap();
        // A little more than half a gigabyte, which is where `image` stops unless it is told otherwise.
        let (width, height) = (1 << 20, 257);
        let file = fs::File::create(root.join("alpha/vast.png")).unwrap();
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_compression(png::Compression::Fastest);
        let mut writer = encoder.write_header().unwrap();
        let mut stream = writer.stream_writer().unwrap();
        let row = vec![0; 2 * width as usize];
        for _ in 0..height {
            stream.write_all(&row).unwrap();
        }
        stream.finish().unwrap();
        writer.finish().unwrap();
        let matte = Run::open(root).unwrap().matte("vast").unwrap();
        assert_eq!((matte.width, matte.height), (width, height));
    }

    #[test]
    fn keys_are_those_that_runs_are_written_under() {
        for (photo, key) in [
            ("000.jpg", "000"),
            ("a/b.c.JPG", "a/b.c"),
            ("a\\b.png", "a/b"),
            ("../up.png", "up"),
            ("/etc/x.png", "etc/x"),
        ] {
            assert_eq!(key_of(photo), key);
        }
    }

    #[test]
    fn commands_name_the_run_and_can_be_pasted() {
        assert_eq!(
            resumed(Path::new("runs/cat")),
            "sos train --resume --out runs/cat"
        );
        assert_eq!(
            repeated(Path::new("my runs/cat")),
            "sos train --config 'my runs/cat/config.toml' --out 'my runs/cat' --force"
        );
    }
}
