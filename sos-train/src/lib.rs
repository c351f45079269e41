//! From posed photos and rough masks to alpha mattes, cut-outs, background plates, normals, depth
//! and a mesh: the program `sos`, and the library it is made of.
//!
//! A run goes through these modules, top to bottom:
//!
//! | module | idea |
//! |---|---|
//! | [`cli`] | what the user asks for, and how the program answers and ends |
//! | [`config`] | all settings: presets, files, `--set` |
//! | [`job`] | the seam: what training is given, what it comes back with |
//! | [`doctor`] | what is wrong with a scene, and what training on it will take |
//! | [`discover`] | without masks, or with few: where and what the object is |
//! | [`prepare`] | the object's box, what the masks agree on, a label per pixel |
//! | [`train`] | the loop: batches, schedules, checkpoints |
//! | [`render`] | final pictures and the mesh; `snap` moves outlines to where photos show them |
//! | [`run_folder`], [`export`] | where results lie, and how they get there in one piece |
//! | [`audit`] | what the results say about themselves without ground truth |
//! | [`report`] | `report.html` |
//! | [`ablation`] | the rows of the paper's table, and rivals, as configurations |
//! | [`results`] | scenes with ground truth from several kinds of masks, in one table |
//! | [`live`] | the page of a run in progress |
//! | [`progress`], [`error`] | what a person sees meanwhile; whose fault an error is |
//!
//! # Example
//! What `sos train --preset quick --set loss.mask=0.2` starts from:
//! ```
//! use sos_train::config::{InputRecord, Preset, RunRecord, TrainConfig};
//!
//! let mut config = TrainConfig::preset(Preset::Quick);
//! config.apply_override("loss.mask=0.2")?;
//!
//! // What a run writes is what repeats it.
//! let input = InputRecord {
//!     scene: "/photos/cat".into(),
//!     masks: None,
//!     polarity: None,
//!     ignore: None,
//!     out: "/runs/cat".into(),
//!     demo: false,
//!     imported_from: None,
//!     photos: None,
//!     click: None,
//!     object_box: None,
//! };
//! let record = RunRecord::new(config, input);
//! assert_eq!(RunRecord::from_toml(&record.to_toml()?)?, record);
//! # Ok::<(), sos_train::config::ConfigError>(())
//! ```

pub mod ablation;
pub mod audit;
mod cells;
pub mod cli;
pub mod config;
pub mod device;
pub mod devices;
pub mod discover;
mod distance;
pub mod doctor;
pub mod error;
pub mod export;
mod flat_zones;
pub mod job;
mod likelihood;
pub mod live;
mod mean;
mod median;
pub mod memory;
pub mod prepare;
pub mod progress;
pub mod render;
pub mod report;
pub mod results;
pub mod run_folder;
mod snap;
mod squares;
pub mod train;
mod voxels;
mod words;
