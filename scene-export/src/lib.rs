//! Turns the folder of a finished run into what other tools read.
//!
//! [`export`] reads a run's pictures and mesh, and where a tool needs cameras the COLMAP scene that the
//! run was made from, and writes one folder:
//!
//! * results in other formats ([`Target`]): multi-layer OpenEXR per view, the mesh as OBJ or GLB, COCO
//!   masks, a COLMAP scene of the object alone, 8-bit mattes, premultiplied cut-outs, videos;
//! * masks in the conventions of other tools ([`MaskTool`]): COLMAP, nerfstudio, Brush, instant-ngp,
//!   NeuS, SPIn-NeRF.
//!
//! Each format is one file of this crate, which begins with what the format means. The folder appears
//! when it is complete, with an `export.txt` that repeats what was decided and lists the files; only a
//! folder that has one, and in which there is nothing else, is ever replaced. The run's own files are
//! not touched. Files are treated as hostile: damage gives an error with file and remedy. Decisions a user
//! should see are left as sentences in [`Written::notes`]; printing is the caller's part.
//!
//! ```no_run
//! use scene_export::{Options, Product, Target, export};
//! use std::path::Path;
//!
//! let run = Path::new("runs/demo");
//! let product = Product::Files("exr".parse::<Target>()?);
//! let written = export(run, product, &product.default_folder(run), &Options::default())?;
//! println!("{} views in {}", written.count, written.folder.display());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod brush_names;
mod coco;
mod colmap_scene;
mod draft;
mod error;
mod exr_layers;
mod ffmpeg;
mod glb;
mod masks;
mod mattes;
mod mesh;
mod neus_cameras;
mod obj;
mod photos;
mod picture;
mod pinhole;
mod product;
mod record;
mod run;
mod run_lengths;
mod spin_nerf;
mod transforms;
mod video;

pub use coco::RunLengths;
pub use draft::Draft;
pub use draft_folder::Existing;
pub use error::{ExportError, UnknownWord};
pub use ffmpeg::{Codec, Ffmpeg, Video};
pub use mesh::mesh_of_run;
pub use picture::{Kind, Picture, encoding_error};
pub use product::{MaskTool, Product, Target};
pub use record::{RECORD, files_of_others};
pub use run::{CAMERAS, has_ended, key_of, quoted};

use run::Run;
use std::path::{Path, PathBuf};

/// What to do besides what is exported.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// The COLMAP scene that the run was made from; `None` to take what the run says.
    pub scene: Option<PathBuf>,
    /// What to do with an earlier export in the folder.
    pub existing: Existing,
    /// How COCO's masks are written.
    pub run_lengths: RunLengths,
    /// Frames a second of videos; `None` for twelve.
    pub rate: Option<u32>,
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Where.
    pub folder: PathBuf,
    /// Number of views or masks, or 1 for a mesh.
    pub count: usize,
    /// Decisions taken, one sentence each.
    pub notes: Vec<String>,
}

impl Written {
    /// A sentence to tell the user.
    #[must_use]
    pub fn sentence(&self, product: Product) -> String {
        let what = match product {
            Product::Files(Target::Obj | Target::Glb) => "the mesh".to_owned(),
            Product::Files(Target::Video) => format!("videos of {} views", self.count),
            Product::Files(Target::Coco) => format!("masks of {} views", self.count),
            Product::Files(_) => format!("{} views", self.count),
            Product::Masks(tool) => format!("{} masks for {}", self.count, tool.name()),
        };
        format!("{}: {what}", self.folder.display())
    }
}

/// Exports a run's results into the folder `out`, which appears when it is complete.
///
/// # Errors
/// [`ExportError`] where there is no finished run, its files are missing or damaged, the scene it was
/// made from is gone or another one, a tool cannot express the scene's cameras, or something is in the
/// way at `out`.
pub fn export(
    run: &Path,
    product: Product,
    out: &Path,
    options: &Options,
) -> Result<Written, ExportError> {
    let run = Run::open(run)?;
    let draft = Draft::begin(out, options.existing)?;
    // What takes every photo of the scene fails where it has no matte.
    let mut notes = match product {
        Product::Files(Target::Exr | Target::Alpha8 | Target::Premultiplied | Target::Video) => {
            run.left_out()
        }
        _ => Vec::new(),
    };
    notes.extend(run.unfinished());
    let count = match product {
        Product::Files(Target::Exr) => exr_layers::write(&run, &draft)?,
        Product::Files(Target::Obj) => {
            obj::write(&mesh_of_run(&run.root)?, &draft)?;
            1
        }
        Product::Files(Target::Glb) => {
            glb::write(&mesh_of_run(&run.root)?, &draft)?;
            1
        }
        Product::Files(Target::Alpha8) => mattes::write_alpha8(&run, &draft)?,
        Product::Files(Target::Premultiplied) => mattes::write_premultiplied(&run, &draft)?,
        Product::Files(Target::Video) => {
            let rate = options.rate.unwrap_or(video::RATE);
            video::write(&run, rate, &draft, &mut notes)?
        }
        Product::Files(Target::Coco) => {
            let scene = run.scene(options.scene.as_deref(), &mut notes)?;
            let posed = run.posed(&scene)?;
            let count = coco::write(&run, &posed, options.run_lengths, &draft)?;
            if count < posed.len() {
                notes.push(format!(
                    "the object is in {count} of {} views; the others have no annotation",
                    posed.len()
                ));
            }
            count
        }
        Product::Files(Target::ColmapScene) => {
            let scene = run.scene(options.scene.as_deref(), &mut notes)?;
            let posed = run.posed(&scene)?;
            colmap_scene::write(&run, &scene, &posed, &draft, &mut notes)?
        }
        Product::Masks(tool) => {
            let scene = run.scene(options.scene.as_deref(), &mut notes)?;
            let posed = run.posed(&scene)?;
            masks::write(tool, &run, &scene, &posed, &draft, &mut notes)?
        }
    };
    draft.finish(&record(&run, product, &notes))?;
    Ok(Written {
        folder: out.to_path_buf(),
        count,
        notes,
    })
}

/// The text of `export.txt`.
fn record(run: &Run, product: Product, notes: &[String]) -> String {
    let mut text = format!(
        "{product}, exported by sos {} from {}\n",
        env!("CARGO_PKG_VERSION"),
        run.root.display()
    );
    for note in notes {
        text.push_str(&format!("- {note}\n"));
    }
    text
}
