//! The checks of [`scene_doctor`], made on what training would work with: the box, the masks' votes and
//! the ground are found by the code that training finds them with.
//!
//! `sos doctor` prints all of them; `sos train` makes the same ones but for the cost, says what it warns about, and
//! stops where one fails.

pub mod admission;
pub mod estimate;
pub mod room;

use crate::config::PrepareConfig;
use crate::discover::{Hint, sparse_ground};
use crate::prepare::error::PrepareError;
use crate::prepare::{Frame, MaskConsensus, TrainView};
use glam::{DVec3, Vec3};
use io_colmap::{Scene, SparsePoint};
use scene_doctor::{Consensus, Exam, ExamView, Ground, ObjectMask, Subject};

/// The ground is looked for this far around the object, over its box.
const SURROUNDINGS: f64 = 1.7;
/// Sparse points that are asked about the ground; more cost time and say the same.
const GROUND_POINTS: usize = 4000;
/// Seed of the planes that are tried.
const SEED: u64 = 1;

/// Where training would look for the object, and what its masks say together.
#[derive(Debug)]
pub struct Location {
    subject: Subject,
    /// What the masks agree on; none where a few masks are hints for a search.
    pub consensus: Option<MaskConsensus>,
    ground: Option<Ground>,
}

impl Location {
    /// Finds the object as training does: where the masks agree, or, with few or none, where these, `hint` or the cameras
    /// say.
    #[must_use]
    pub fn find(
        views: &[TrainView],
        points: &[SparsePoint],
        hint: &Hint,
        config: &PrepareConfig,
    ) -> Self {
        // Around what masks agree on, what it stands on has to be seen too. A region without masks holds that already, and
        // training looks for the ground in it as it is.
        let mut surroundings = 1.0;
        let of_masks = Hint::of_few_masks(views);
        let is_masked = views.iter().any(|view| view.mask.is_some());
        let (frame, by, consensus) = match of_masks.as_ref().or((!is_masked).then_some(hint)) {
            Some(hint) => (hint.region(views, points), by_hint(hint), None),
            None => match MaskConsensus::of(views, points, config) {
                Ok(found) => {
                    surroundings = SURROUNDINGS;
                    (Ok(found.frame), "where the masks agree", Some(found))
                }
                Err(error) => (Err(error), "", None),
            },
        };
        Self {
            ground: frame.as_ref().ok().and_then(|frame| {
                let around = Frame {
                    half_side: surroundings * frame.half_side,
                    ..*frame
                };
                ground(views, points, &around)
            }),
            subject: subject(frame, by),
            consensus,
        }
    }

    /// What the masks agree on, as the checks read it. `limit` is the share of masks that makes an
    /// object.
    #[must_use]
    pub fn mask_consensus(&self, limit: f32) -> Option<Consensus> {
        self.consensus.as_ref().map(|found| Consensus {
            silhouettes: found.silhouettes.clone(),
            limit: (255.0 * limit) as u8,
            trust: found.trust.0.clone(),
        })
    }

    /// What the checks look at; `scene` is the one the views were loaded from.
    #[must_use]
    pub fn exam<'a>(&self, views: &'a [TrainView], scene: &'a Scene) -> Exam<'a> {
        let exam_views = views
            .iter()
            .zip(&scene.model.views)
            .map(|(view, of_model)| ExamView {
                name: &view.name,
                id: of_model.id,
                camera: &view.lens.0,
                camera_from_world: view.camera_from_world,
                photo: &view.photo,
                mask: view.mask.as_ref().map(|mask| mask as &dyn ObjectMask),
            })
            .collect();
        Exam::new(
            exam_views,
            &scene.model.points,
            self.subject.clone(),
            self.ground,
        )
    }
}

fn by_hint(hint: &Hint) -> &'static str {
    match hint {
        Hint::Nothing => "to be looked for where the cameras look",
        Hint::Click(_) => "to be looked for around the click",
        Hint::Box(_) => "to be looked for in the box that was given",
        Hint::Masks(_) => "to be looked for around what the masks show",
    }
}

fn subject(frame: Result<Frame, PrepareError>, by: &str) -> Subject {
    match frame {
        Ok(frame) => Subject::Found {
            centre: frame.centre,
            half_side: frame.half_side,
            by: by.to_owned(),
        },
        Err(error) => Subject::Unknown {
            why: error.to_string(),
        },
    }
}

/// The plane that things stand on in the region `around`.
fn ground(views: &[TrainView], points: &[SparsePoint], around: &Frame) -> Option<Ground> {
    let cameras: Vec<Vec3> = views
        .iter()
        .map(|view| around.normalised_from_world(view.camera_from_world.centre()))
        .collect();
    let stride = points.len().div_ceil(GROUND_POINTS).max(1);
    let normalised: Vec<Vec3> = points
        .iter()
        .step_by(stride)
        .map(|point| around.normalised_from_world(point.position))
        .collect();
    let plane = sparse_ground::ground(&normalised, &cameras, SEED)?;
    let normal: DVec3 = plane.normal.as_dvec3().try_normalize()?;
    Some(Ground {
        normal,
        point: around.world_from_normalised(plane.normal * plane.offset),
    })
}
