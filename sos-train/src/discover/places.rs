//! What is known of places before anything is learnt.

use std::sync::atomic::AtomicBool;

use glam::DVec3;
use io_colmap::SparsePoint;

use super::sweep;
use crate::prepare::error::PrepareError;
use crate::prepare::{Sights, TrainView};

/// Places on surfaces, in the scene's frame, and which views see some.
#[derive(Debug)]
pub(super) struct Places {
    pub(super) points: Vec<DVec3>,
    pub(super) sights: Sights,
}

impl Places {
    /// The sparse `points` with the `sights` of them. Where there are none, or the model does not say who sees them, what the
    /// photos of `views` tell, as far as it comes until `interrupt`; `progress` is told which of these is asked now, of how many.
    pub(super) fn known(
        views: &[TrainView],
        points: &[SparsePoint],
        sights: &Sights,
        interrupt: &AtomicBool,
        progress: impl FnMut(u32, u32),
    ) -> Result<Self, PrepareError> {
        let mut known = Self {
            points: points.iter().map(|point| point.position).collect(),
            sights: sights.clone(),
        };
        if !known.sights.is_empty() {
            return Ok(known);
        }
        let found = sweep::everywhere(views, interrupt, progress)?;
        known.sights = Sights::new(found.iter().map(|place| {
            let views = place.views.iter().map(|view| *view as u32);
            (place.position, views.collect())
        }));
        if known.points.is_empty() {
            known.points = found.iter().map(|place| place.position).collect();
        }
        Ok(known)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::super::sweep::tests::{BOARD, board_before_wall};
    use super::*;

    #[test]
    fn places_without_witnesses_get_some_from_the_photos() {
        let views = board_before_wall();
        let go_on = AtomicBool::new(false);
        let known = |points: &[SparsePoint], sights: &Sights| {
            Places::known(&views, points, sights, &go_on, |_, _| {}).unwrap()
        };
        let swept = known(&[], &Sights::default());
        let at_board = |place: &DVec3| (place.z / BOARD - 1.0).abs() < 0.15;
        assert!(swept.points.iter().filter(|place| at_board(place)).count() > 30);
        assert!(swept.sights.as_slice().len() > 100);
        assert!(
            swept
                .sights
                .as_slice()
                .iter()
                .any(|(_, place)| at_board(place))
        );
        let point = SparsePoint {
            id: 1,
            position: DVec3::Z,
            colour: [0; 3],
            error: 0.0,
            views: Vec::new(),
        };
        let told = known(std::slice::from_ref(&point), &Sights::default());
        assert_eq!(told.points, [DVec3::Z]);
        assert_eq!(told.sights, swept.sights);
        let all_known = known(&[point], &swept.sights);
        assert_eq!(
            (all_known.points.len(), &all_known.sights),
            (1, &swept.sights)
        );
        // Nothing more is looked for then.
        go_on.store(true, Ordering::Relaxed);
        assert!(known(&[], &Sights::default()).points.is_empty());
    }
}
