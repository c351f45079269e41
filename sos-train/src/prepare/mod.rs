//! From photos and rough masks to what training needs: box, probability map, labels.

#[cfg(test)]
pub(crate) mod balls;
mod clearance;
mod consensus;
pub(crate) mod depth_range;
#[cfg(test)]
pub(crate) mod disc;
pub mod edge_contrast;
pub mod error;
pub mod frame;
pub mod label;
pub mod locate;
pub mod mask;
mod mask_edge;
pub mod mask_faults;
pub mod mask_shift;
pub mod outline;
pub mod pixels;
pub mod runs;
pub mod sights;
pub mod spans;
pub mod view;
pub mod votes;

use glam::Vec3;
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;

pub use consensus::MaskConsensus;
pub use frame::Frame;
pub use label::{Label, Shown, Vote};
pub use outline::Outline;
pub use sights::Sights;
pub use view::TrainView;

use crate::config::PrepareConfig;
use error::PrepareError;
use mask::Mask;
use votes::{Quorum, ViewTrust, vote_grid};

/// Voxels per axis of m^P.
pub(crate) const MAP_RESOLUTION: usize = 128;
/// Radius, in the normalised frame, of the ball that stands in for masks when there are none.
const DEFAULT_BALL: f32 = 0.7;

/// A scene, ready to train on.
#[derive(Debug)]
pub struct Prepared {
    /// The photos, with masks as they are now.
    pub views: Vec<TrainView>,
    /// The masks as they were given.
    pub given_masks: Vec<Option<Mask>>,
    /// Between the scene's frame and the normalised one.
    pub frame: Frame,
    /// m^P over the box.
    pub map: ProbabilityMap,
    /// Labels per view.
    pub outlines: Vec<Outline>,
    /// How far each view's mask is believed.
    pub trust: ViewTrust,
    /// Which places are heard when masks vote.
    pub quorum: Quorum,
    /// Sparse points in the box, the object's and others, in the normalised frame.
    pub points: Vec<Vec3>,
    /// Where some rays are known to end, at the object and elsewhere; none where nothing is learnt from it.
    pub sights: Sights,
    /// What a user should know about the choices made, a sentence each.
    pub notes: Vec<String>,
}

/// What is known of a scene before it is prepared.
#[derive(Debug, Default)]
pub struct KnownScene {
    /// What the views' masks say together; found out where there are masks and it is not known.
    pub consensus: Option<MaskConsensus>,
    /// The box that a run lives in since its start.
    pub frame: Option<Frame>,
}

/// Finds the object's box, lets the masks vote on space, and labels every pixel. `points` are the
/// model's sparse points.
///
/// # Errors
/// When masks or cameras do not determine a box.
pub fn prepare(
    views: Vec<TrainView>,
    points: &[SparsePoint],
    config: &PrepareConfig,
    ignore_band: f32,
) -> Result<Prepared, PrepareError> {
    prepare_with(views, KnownScene::default(), points, config, ignore_band)
}

/// As [`prepare`], with what is known already.
///
/// # Errors
/// When masks or cameras do not determine a box that is not known.
pub fn prepare_with(
    views: Vec<TrainView>,
    known: KnownScene,
    points: &[SparsePoint],
    config: &PrepareConfig,
    ignore_band: f32,
) -> Result<Prepared, PrepareError> {
    let mut notes = Vec::new();
    let mut consensus = known.consensus;
    if consensus.is_none() && views.iter().any(|view| view.mask.is_some()) {
        let found = MaskConsensus::of(&views, points, config)?;
        notes.extend(found.note(&views));
        consensus = Some(found);
    }
    let (frame, map, trust, quorum) = if let Some(found) = consensus {
        let frame = known.frame.unwrap_or(found.frame);
        let (trust, quorum) = (found.trust, found.quorum);
        let votes = vote_grid(&views, &frame, MAP_RESOLUTION, &trust, quorum);
        let map = ProbabilityMap::new(MAP_RESOLUTION, votes);
        (frame, map, trust, quorum)
    } else {
        notes.push(
            "no masks: the object is taken to be what stands where the cameras look".to_string(),
        );
        let frame = match known.frame {
            Some(frame) => frame,
            None => locate::box_from_cameras(&views)?,
        };
        let ball = (0..MAP_RESOLUTION.pow(3))
            .map(|cell| {
                let r = ProbabilityMap::centre(MAP_RESOLUTION, cell).length();
                ((DEFAULT_BALL - r) * 4.0 + 0.5).clamp(0.0, 1.0)
            })
            .collect();
        let map = ProbabilityMap::new(MAP_RESOLUTION, ball);
        (frame, map, ViewTrust(vec![0.0; views.len()]), Quorum::OfAll)
    };
    notes.push(format!(
        "object box: centre ({:.4}, {:.4}, {:.4}), side {:.4} in the scene's unit",
        frame.centre.x,
        frame.centre.y,
        frame.centre.z,
        2.0 * frame.half_side
    ));
    let outlines = outlines(&views, &frame, &map, &trust, config, ignore_band);
    let points = points
        .iter()
        .map(|point| frame.normalised_from_world(point.position))
        .filter(|point: &Vec3| point.abs().max_element() <= 1.0)
        .collect();
    Ok(Prepared {
        points,
        sights: Sights::default(),
        given_masks: views.iter().map(|view| view.mask.clone()).collect(),
        views,
        frame,
        map,
        outlines,
        trust,
        quorum,
        notes,
    })
}

/// The labels of all views.
fn outlines(
    views: &[TrainView],
    frame: &Frame,
    map: &ProbabilityMap,
    trust: &ViewTrust,
    config: &PrepareConfig,
    ignore_band: f32,
) -> Vec<Outline> {
    const STRIDE: u32 = 2;
    views
        .iter()
        .zip(&trust.0)
        .map(|(view, &trust)| {
            let silhouette = outline::silhouette(view, frame, map, STRIDE);
            let area = silhouette.pixels().filter(|p| p.0[0] >= 128).count() as f32;
            let size = 2.0 * (area / std::f32::consts::PI).sqrt() * STRIDE as f32;
            let band = (0.5 * ignore_band * size).round().max(1.0) as u32;
            outline::outline(view, &silhouette, STRIDE, trust, band, config)
        })
        .collect()
}
