//! Several results for the same views, side by side.

use crate::EvalError;
use crate::folders::compare_folders;
use crate::matching::{list_pictures, match_views};
use crate::mattes::{Mattes, Reading};
use crate::picture::Plane;
use crate::report::Report;
use crate::run::run_eval;
use crate::table::{markdown_cells, markdown_headings, score_cells, score_headings};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A result to be compared: a run, or a folder of mattes or masks that any other system made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contender {
    /// What it is called in the table.
    pub name: String,
    /// A run folder (with `alpha/` in it), or a folder of pictures.
    pub dir: PathBuf,
}

impl Contender {
    /// `NAME=DIR`, or `DIR`, which is then called by its last part.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        if let Some((name, dir)) = text.split_once('=')
            && !name.is_empty()
            && !Path::new(text).exists()
        {
            return Self {
                name: name.to_owned(),
                dir: PathBuf::from(dir),
            };
        }
        let dir = PathBuf::from(text);
        // Resolved, so that "." and ".." have a name.
        let full = dir.canonicalize().unwrap_or_else(|_| dir.clone());
        let name = full
            .file_name()
            .map_or(text.into(), |name| name.to_string_lossy());
        Self {
            name: name.into_owned(),
            dir,
        }
    }

    /// Where its mattes lie.
    #[must_use]
    pub fn mattes(&self) -> PathBuf {
        let inner = self.dir.join("alpha");
        if inner.is_dir() {
            inner
        } else {
            self.dir.clone()
        }
    }
}

/// One line of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    /// The contender's name.
    pub name: String,
    /// Its scores.
    pub report: Report,
}

/// Scores of all contenders against the same truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// In the order given.
    pub contenders: Vec<Compared>,
}

/// Scores every contender against `gt_dir`, a scene with `alpha_gt/` or a folder of true mattes.
/// Runs are scored on plates and mesh too, where the truth has them (see [`run_eval`]).
///
/// # Errors
/// [`EvalError`] if a folder holds no pictures or one cannot be read.
pub fn compare_contenders(
    contenders: &[Contender],
    gt_dir: &Path,
) -> Result<Comparison, EvalError> {
    let alpha_gt = true_mattes(gt_dir);
    let contenders = contenders
        .iter()
        .map(|contender| {
            let report = if contender.dir.join("alpha").is_dir() {
                run_eval(&contender.dir, gt_dir, None)?
            } else {
                compare_folders(&contender.dir, &alpha_gt, None)?
            };
            Ok(Compared {
                name: contender.name.clone(),
                report,
            })
        })
        .collect::<Result<_, EvalError>>()?;
    Ok(Comparison { contenders })
}

/// The folder of true mattes: `alpha_gt/` in a scene, or the folder itself.
#[must_use]
pub fn true_mattes(gt_dir: &Path) -> PathBuf {
    let inner = gt_dir.join("alpha_gt");
    if inner.is_dir() {
        inner
    } else {
        gt_dir.to_owned()
    }
}

/// The picture that shows a view in one folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MatteFile {
    /// Where it is.
    pub path: PathBuf,
    /// As its folder is read.
    reading: Reading,
}

impl MatteFile {
    /// Reads it as it is scored: numbers of some tools that are not black and white become so.
    ///
    /// # Errors
    /// [`EvalError`] if it cannot be read.
    pub fn read(&self) -> Result<Plane, EvalError> {
        self.reading.read(&self.path)
    }
}

/// A view's name and its files: the true matte, then one for each contender.
pub type ViewFiles = (String, Vec<Option<MatteFile>>);

/// The files that show each view: the true matte, then every contender's, `None` where it has none.
///
/// # Errors
/// [`EvalError`] if a folder holds no pictures or names are ambiguous.
pub fn mattes_by_view(
    contenders: &[Contender],
    gt_dir: &Path,
) -> Result<Vec<ViewFiles>, EvalError> {
    let alpha_gt = true_mattes(gt_dir);
    let truth = list_pictures(&alpha_gt)?.pictures;
    let mut columns = vec![(Mattes::of(&alpha_gt, &truth)?.reading(), truth.clone())];
    for contender in contenders {
        let folder = contender.mattes();
        let pictures = match_views(&alpha_gt, &truth, &folder)?.pictures;
        columns.push((Mattes::of(&folder, &pictures)?.reading(), pictures));
    }
    let file = |reading: Reading, path: &PathBuf| MatteFile {
        path: path.clone(),
        reading,
    };
    Ok(truth
        .keys()
        .map(|name| {
            let files = columns
                .iter()
                .map(|(reading, pictures)| pictures.get(name).map(|path| file(*reading, path)));
            (name.clone(), files.collect())
        })
        .collect())
}

impl Compared {
    /// The plates' PSNR where seen, in dB, and the mesh's chamfer distance in % of the object's size.
    fn plate_and_mesh(&self) -> [String; 2] {
        let plate = self.report.plate.as_ref().and_then(|plate| plate.seen);
        let mesh = self.report.mesh.as_ref().map(|mesh| mesh.relative.chamfer);
        [
            plate.map_or("-".to_owned(), |seen| format!("{:.2}", seen.psnr)),
            mesh.map_or("-".to_owned(), |share| format!("{:.3}", 100.0 * share)),
        ]
    }
}

impl Comparison {
    /// [`Comparison::table`] in Markdown, without what is missing.
    #[must_use]
    pub fn markdown(&self) -> String {
        let headings = markdown_headings();
        let rule = "---:|".repeat(headings.len() + 2);
        let mut out = format!(
            "| | {} | plate | mesh |\n|---|{rule}\n",
            headings.join(" | ")
        );
        for compared in &self.contenders {
            let name = compared.name.replace('|', "\\|");
            let scores = markdown_cells(&compared.report.mean).join(" | ");
            let [plate, mesh] = compared.plate_and_mesh();
            // Writing to a string cannot fail.
            let _ = writeln!(out, "| {name} | {scores} | {plate} | {mesh} |");
        }
        out
    }

    /// One line a contender: the mean of each metric, the plates' PSNR where seen in dB, the mesh's
    /// chamfer distance in % of the object's size; `-` where there is none.
    #[must_use]
    pub fn table(&self) -> String {
        let names = self.contenders.iter().map(|c| c.name.chars().count());
        let width = names.max().unwrap_or(0);
        let mut out = format!("{:width$}", "");
        out.push_str(&score_headings());
        out.push_str("     plate      mesh\n");
        for compared in &self.contenders {
            let [plate, mesh] = compared.plate_and_mesh();
            let (name, scores) = (&compared.name, score_cells(&compared.report.mean));
            // Writing to a string cannot fail.
            let _ = writeln!(out, "{name:width$}{scores}  {plate:>8}  {mesh:>8}");
        }
        for Compared { name, report } in &self.contenders {
            if !report.missing.is_empty() {
                let _ = writeln!(
                    out,
                    "{name}: {} of {} mattes missing, counted as empty",
                    report.missing.len(),
                    report.views.len()
                );
            }
            for note in &report.notes {
                let _ = writeln!(out, "{name}: {note}");
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contender_is_named_or_named_by_its_folder() {
        let named = Contender::parse("SAM=masks/sam");
        assert_eq!(
            (named.name.as_str(), named.dir),
            ("SAM", "masks/sam".into())
        );
        let plain = Contender::parse("runs/cat");
        assert_eq!((plain.name.as_str(), plain.dir), ("cat", "runs/cat".into()));
    }
}
