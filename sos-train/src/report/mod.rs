//! `report.html`: one page that shows what a run did, to be looked at, kept and sent around.
//!
//! It needs nothing but itself: pictures are thumbnails inside the page, curves are drawn in it, and so
//! is the mesh, made small. Sliders, the large view and the mesh are two small scripts (`stage.js`,
//! `viewer.js`); without them, or without WebGL, the rest is there all the same. When a script is up it
//! says so in `data-ready` of the document's root, and what goes wrong is in `data-errors`.
//! Everything comes from the run's folder and the scene's photos and masks, so that the page can be
//! made again at any time. A thumbnail of the run's own results leads to the file at full size, as
//! long as page and files lie together.

mod audited;
mod comparison;
mod curves;
mod inputs;
mod mesh;
mod page;
mod thumbnail;
mod views;

pub use comparison::comparison_page;
pub(crate) use curves::plots;
pub use inputs::ReportInputs;
pub(crate) use page::STYLE;
pub(crate) use thumbnail::{jpeg_bytes, open as open_picture};

use crate::export::ExportError;
use crate::run_folder::{RunError, RunFolder};
use std::io::Write as _;
use std::path::PathBuf;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The run's folder.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A picture that belongs to the report but lies beside it.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The run's configuration.
    #[error("{}: {reason}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Scene or masks.
    #[error(transparent)]
    Scene(#[from] io_colmap::ColmapError),
    /// Mattes to compare.
    #[error(transparent)]
    Scores(#[from] sos_eval::EvalError),
    /// A picture that cannot be read.
    #[error("cannot read the picture {} for the report ({reason}); check that it is as the run left it", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
}

/// Writes `report.html`.
///
/// # Errors
/// [`ReportError`] if a picture cannot be read or the page cannot be written.
pub fn write_report(run: &RunFolder, inputs: &ReportInputs) -> Result<(), ReportError> {
    let rows = views::rows(run, inputs)?;
    // Where no surface was found there is no mesh, and the page does without; of one that is damaged it says so.
    let read = run
        .mesh_path()
        .is_file()
        .then(|| scene_export::mesh_of_run(run.root()))
        .transpose();
    let (mesh, fault) = match read {
        Ok(mesh) => (mesh, None),
        Err(error) => (None, Some(format!("the mesh is not shown: {error}"))),
    };
    let mesh = mesh.and_then(|mesh| mesh::packed(&mesh, &inputs.scene.model.views));
    let page = page::page(inputs, &rows, mesh.as_ref(), fault.as_deref());
    run.write(&run.report_path(), |out| out.write_all(page.as_bytes()))?;
    Ok(())
}
