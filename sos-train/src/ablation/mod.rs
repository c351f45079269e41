//! What the parts of the method are worth: the rows of the paper's ablation, rivals on equal terms, and
//! other choices where the method leaves one.
//!
//! A row is a name and what it is: settings over the user's own, with or without masks; or mattes that
//! nobody trained for. No row has code of its own.
//!
//! | row | in the paper | reading |
//! |---|---|---|
//! | `no-mask-object` | no mask, F | FoCoR alone, from masks that the run finds by itself |
//! | `no-mask-both` | no mask, F + B | the method, from masks that the run finds by itself |
//! | `mask` | mask only | the coarse masks as they are |
//! | `object` | mask + F | FoCoR alone |
//! | `no-sparsity` | mask + F + B without sparsity | the method without the sparsity loss |
//! | `all` | all | the method |
//!
//! The paper does not say what its F explains a photo's other pixels by. FoCoR alone is read as NeuS is
//! trained with masks: no background; pixels that the masks take for the object teach colours, and the
//! mask loss, which elsewhere ends early because BaCo takes over, stays for the whole run, as nothing
//! else says where the object ends. There is no carving either, which is BaCo's work.
//!
//! Rivals have the same grids, budget, rays and masks: `hull`, the masks' soft visual hull; `density`, the
//! method with a radiance field for FoCoR (nothing that speaks of a distance applies: Eikonal and
//! sparsity losses, sparse points); `semantic`, one radiance field that learns a share of the object
//! ([`train::semantic`](crate::train::semantic)).
//!
//! [`DECISIONS`] change one setting of the default preset each, to what the paper or others choose.

mod spread;

use serde::Serialize;
use sos_eval::{Compared, Comparison};
use std::fmt::Write as _;

pub use spread::{OverSeeds, Spread};

/// A line of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Its folder.
    pub name: &'static str,
    /// What it is called in the table.
    pub title: &'static str,
    /// What it is.
    pub kind: Kind,
}

/// What a row's mattes come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The start masks as they are.
    Masks,
    /// The start masks' soft visual hull.
    Hull,
    /// A run.
    Run {
        /// Whether it is given the start masks.
        start: Start,
        /// Settings, laid over the user's.
        settings: &'static [&'static str],
    },
}

/// What a run begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// The start masks.
    Masks,
    /// Photos alone.
    Nothing,
}

const OBJECT_ALONE: &[&str] = &["model.fields=object", "loss.mask_hold=1", "loss.mask_end=1"];

/// The paper's table, in its order.
pub const TABLE: [Row; 6] = [
    run("no-mask-object", "no mask, F", Start::Nothing, OBJECT_ALONE),
    run("no-mask-both", "no mask, F + B", Start::Nothing, &[]),
    Row {
        name: "mask",
        title: "mask only",
        kind: Kind::Masks,
    },
    run("object", "mask + F", Start::Masks, OBJECT_ALONE),
    run(
        "no-sparsity",
        "mask + F + B, no sparsity",
        Start::Masks,
        &["loss.sparsity=0"],
    ),
    run("all", "all", Start::Masks, &[]),
];

/// What else the masks can be refined by.
pub const RIVALS: [Row; 3] = [
    Row {
        name: "hull",
        title: "soft visual hull",
        kind: Kind::Hull,
    },
    run(
        "density",
        "radiance field for FoCoR",
        Start::Masks,
        &["model.foreground=density"],
    ),
    run(
        "semantic",
        "semantic field",
        Start::Masks,
        &["model.fields=semantic", "model.background=density"],
    ),
];

/// The default preset with another choice for one of its settings.
pub const DECISIONS: [Row; 21] = [
    choice("alpha-head", "alpha: the network's", &["model.alpha=head"]),
    choice("alpha-both", "alpha: both", &["model.alpha=both"]),
    choice("blend-ray", "blend per ray", &["model.blend=ray"]),
    choice(
        "probability-hull",
        "m^P: the hull",
        &["model.probability=hull"],
    ),
    choice("half", "m^P: half of the votes", &["model.majority=half"]),
    choice("together", "no carving", &["schedule.carve=0"]),
    choice("surface", "BaCo is a surface", &["model.background=sdf"]),
    choice(
        "outside",
        "BaCo alone outside masks",
        &["loss.background=1"],
    ),
    choice("no-points", "no sparse points", &["loss.points=0"]),
    choice("smooth", "smoothstep", &["model.interpolation=smoothstep"]),
    choice("nodes", "vertices hashed one by one", &["model.hash=nodes"]),
    choice("curvature", "curvature", &["loss.curvature=0.03"]),
    choice("band", "no ignore band", &["loss.ignore_band=0"]),
    choice(
        "mask-long",
        "mask loss to 70 %",
        &["loss.mask_hold=0.5", "loss.mask_end=0.7"],
    ),
    choice("untrusted", "masks end early", &["loss.mask_trusted=0"]),
    choice("eikonal-less", "Eikonal 0.01", &["loss.eikonal=0.01"]),
    choice("eikonal-more", "Eikonal 0.1", &["loss.eikonal=0.1"]),
    choice("sparsity-more", "sparsity 0.03", &["loss.sparsity=0.03"]),
    choice(
        "levels",
        "all levels at once",
        &["schedule.first_levels=32"],
    ),
    choice(
        "surface-outline",
        "mattes end where the surface does",
        &["export.follow_photos=false"],
    ),
    choice("squares", "squared colour loss", &["loss.colour=l2"]),
];

const fn choice(name: &'static str, title: &'static str, settings: &'static [&'static str]) -> Row {
    run(name, title, Start::Masks, settings)
}

const fn run(
    name: &'static str,
    title: &'static str,
    start: Start,
    settings: &'static [&'static str],
) -> Row {
    Row {
        name,
        title,
        kind: Kind::Run { start, settings },
    }
}

impl Row {
    /// Every row: the table's, rivals, decisions.
    pub fn every() -> impl Iterator<Item = Self> {
        TABLE.into_iter().chain(RIVALS).chain(DECISIONS)
    }

    /// The row of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::every().find(|row| row.name == name)
    }

    /// All names, the table's first.
    #[must_use]
    pub fn names() -> Vec<&'static str> {
        Self::every().map(|row| row.name).collect()
    }

    /// What it is, in the words of the command line.
    #[must_use]
    pub fn definition(&self) -> String {
        match self.kind {
            Kind::Masks => "the coarse masks as they are".to_owned(),
            Kind::Hull => "sos hull".to_owned(),
            Kind::Run { start, settings } => {
                let mut words = "sos train".to_owned();
                if start == Start::Nothing {
                    words.push_str(" --masks none");
                }
                for setting in settings {
                    // Writing to a string cannot fail.
                    let _ = write!(words, " --set {setting}");
                }
                words
            }
        }
    }
}

/// In a folder's name, between the row and a seed of its own.
const BEFORE_SEED: &str = "-seed";

/// A row with a seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trial {
    /// The row.
    pub row: Row,
    /// A seed of its own; none for the one that the settings have.
    pub seed: Option<u64>,
}

impl Trial {
    /// `row` with the settings' seed `first` and, if it is a run, the `seeds - 1` after it.
    pub fn of(row: Row, first: u64, seeds: u32) -> impl Iterator<Item = Self> {
        let more = match row.kind {
            Kind::Masks | Kind::Hull => 0,
            Kind::Run { .. } => u64::from(seeds.saturating_sub(1)),
        };
        let others = (1..=more).map(move |i| Some(first.wrapping_add(i)));
        let all = std::iter::once(None).chain(others);
        all.map(move |seed| Self { row, seed })
    }

    /// The trial whose folder is called so.
    #[must_use]
    pub fn of_folder(name: &str) -> Option<Self> {
        if let Some(row) = Row::named(name) {
            return Some(Self { row, seed: None });
        }
        let (row, seed) = name.rsplit_once(BEFORE_SEED)?;
        let trial = Self {
            row: Row::named(row)?,
            seed: Some(seed.parse().ok()?),
        };
        (trial.folder() == name).then_some(trial)
    }

    /// Its folder.
    #[must_use]
    pub fn folder(&self) -> String {
        self.named(self.row.name, BEFORE_SEED)
    }

    /// What it is called in the table.
    #[must_use]
    pub fn title(&self) -> String {
        self.named(self.row.title, ", seed ")
    }

    fn named(&self, what: &str, before_seed: &str) -> String {
        match self.seed {
            None => what.to_owned(),
            Some(seed) => format!("{what}{before_seed}{seed}"),
        }
    }

    /// What it is, in the words of the command line.
    #[must_use]
    pub fn definition(&self) -> String {
        self.named(&self.row.definition(), " --set seed=")
    }
}

/// The table as it is written down.
#[derive(Debug, Clone, Serialize)]
pub struct Ablation {
    /// The scene, as it was named.
    pub scene: String,
    /// What all runs were given besides their own settings, in the words of the command line.
    pub settings: String,
    /// In the table's order.
    pub rows: Vec<Scored>,
    /// Rows that ran with more than one seed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub over_seeds: Vec<OverSeeds>,
}

/// A row with its scores.
#[derive(Debug, Clone, Serialize)]
pub struct Scored {
    /// The row's name.
    pub row: &'static str,
    /// The row's title.
    #[serde(skip)]
    pub title: &'static str,
    /// Its folder.
    pub folder: String,
    /// What it is: [`Trial::definition`].
    pub definition: String,
    /// Seconds of its whole run, pictures included; none where nothing was trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Title and scores.
    #[serde(flatten)]
    pub compared: Compared,
}

impl Ablation {
    /// Of `rows` in the table's order.
    #[must_use]
    pub fn new(scene: String, settings: String, rows: Vec<Scored>) -> Self {
        Self {
            scene,
            settings,
            over_seeds: spread::over_seeds(&rows),
            rows,
        }
    }

    /// The table as aligned text.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = self.comparison().table();
        if !self.over_seeds.is_empty() {
            out.push_str("\nmean and standard deviation over seeds\n");
            out.push_str(&spread::table(&self.over_seeds));
        }
        out
    }

    /// The scores alone.
    #[must_use]
    pub fn comparison(&self) -> Comparison {
        Comparison {
            contenders: self.rows.iter().map(|row| row.compared.clone()).collect(),
        }
    }

    /// A page of Markdown: the table, and what each row is.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut out = format!("# Ablation of {}\n\n", self.scene);
        // Writing to a string cannot fail, here and below.
        if !self.settings.is_empty() {
            let _ = writeln!(out, "All runs with `{}`.\n", self.settings);
        }
        out.push_str(&self.comparison().markdown());
        out.push_str(
            "\nIoU, mIoU, accuracy and boundary IoU are better when higher; SAD, MSE, gradient and \
             connectivity error when lower. Plate: PSNR in dB where seen. Mesh: chamfer distance in % \
             of the object's size.\n\n",
        );
        if !self.over_seeds.is_empty() {
            out.push_str("Mean and standard deviation over seeds:\n\n");
            out.push_str(&spread::markdown(&self.over_seeds));
            out.push('\n');
        }
        for row in &self.rows {
            let _ = write!(
                out,
                "- {} (`{}/`): `{}`",
                row.compared.name, row.folder, row.definition
            );
            if let Some(seconds) = row.seconds {
                let _ = write!(out, ", {seconds:.0} s");
            }
            let missing = row.compared.report.missing.len();
            if missing > 0 {
                let _ = write!(out, ", {missing} mattes missing, counted as empty");
            }
            out.push('\n');
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::config::{Preset, TrainConfig};
    use std::collections::BTreeSet;

    #[test]
    fn every_row_is_a_configuration_that_works_and_differs() {
        for preset in [Preset::Quick, Preset::Default, Preset::Paper] {
            let mut seen = BTreeSet::new();
            for row in Row::every() {
                assert_eq!(Row::named(row.name), Some(row));
                let Kind::Run { start, settings } = row.kind else {
                    continue;
                };
                // The paper's preset has made some of the other choices already.
                if preset == Preset::Paper && DECISIONS.contains(&row) {
                    continue;
                }
                let mut config = TrainConfig::preset(preset);
                for setting in settings {
                    config.apply_override(setting).unwrap();
                }
                config.validate().unwrap();
                let text = toml::to_string(&config).unwrap();
                assert!(
                    seen.insert((start == Start::Masks, text)),
                    "{preset}: {} is another row's twin",
                    row.name
                );
            }
            let others = if preset == Preset::Paper {
                0
            } else {
                DECISIONS.len()
            };
            assert_eq!(seen.len(), 7 + others);
        }
        assert_eq!(Row::named("everything"), None);
    }
}
