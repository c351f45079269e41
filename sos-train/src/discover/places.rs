//! What is known of places before anything is learnt.

use glam::DVec3;
use io_colmap::SparsePoint;

use super::sweep;
use crate::prepare::error::PrepareError;
use crate::prepare::{Sights, TrainView};

/// Places on surfaces, in the scene's frame, and which views see some.
#[derive(Clone, Debug, Default)]
pub(super) struct Places {
    pub(super) points: Vec<DVec3>,
    pub(super) sights: Sights,
}

impl Places {
    /// The sparse `points` with the `sights` of them; for a scene without any, what the photos of `views` tell.
    pub(super) fn known(
        views: &[TrainView],
        points: &[SparsePoint],
        sights: &Sights,
    ) -> Result<Self, PrepareError> {
        if !points.is_empty() {
            return Ok(Self {
                points: points.iter().map(|point| point.position).collect(),
                sights: sights.clone(),
            });
        }
        let places = sweep::everywhere(views)?;
        let seen = places.iter().flat_map(|place| {
            let views = place.views.iter().copied();
            views.map(|view| (view as u32, place.position))
        });
        Ok(Self {
            sights: Sights::new(seen),
            points: places.iter().map(|place| place.position).collect(),
        })
    }
}
