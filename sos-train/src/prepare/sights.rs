//! Where some rays are known to end.
//!
//! Places that photos were matched by are seen in all of these, so that nothing stands before them there. Learnt with few
//! views, a field has floaters and bulges that all photos can be explained with; where their rays are known to end it has
//! not (Deng et al. 2022, "Depth-supervised NeRF: Fewer Views and Faster Training for Free").

use std::collections::HashMap;

use glam::DVec3;
use io_colmap::Model;

/// Pixels of reprojection error up to which a point is where it is said to be.
const MOST_ERROR: f64 = 2.0;
/// Views that have to see a place: two can be mistaken together.
const LEAST_VIEWS: usize = 3;
/// More than so many are thinned out evenly: they would say the same.
const MOST_SIGHTS: usize = 200_000;
/// Fewer say too little.
const LEAST_SIGHTS: usize = 100;

/// Places in the scene's frame, each with the number of a view that is known to see it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sights(Vec<(u32, DVec3)>);

impl Sights {
    /// What the views of a model see of its sparse points.
    #[must_use]
    pub fn of_points(model: &Model) -> Self {
        let views = model.views.iter().zip(0..);
        let number: HashMap<u32, u32> = views.map(|(view, number)| (view.id, number)).collect();
        let exact = model.points.iter().filter(|p| p.error <= MOST_ERROR);
        Self::new(exact.map(|point| {
            let views = point.views.iter().filter_map(|id| number.get(id).copied());
            (point.position, views.collect())
        }))
    }

    /// Of places and the numbers of the views that see each; none where these are too few.
    #[must_use]
    pub fn new(places: impl Iterator<Item = (DVec3, Vec<u32>)> + Clone) -> Self {
        let sure = places.filter(|(_, views)| views.len() >= LEAST_VIEWS);
        let all: usize = sure.clone().map(|(_, views)| views.len()).sum();
        if all < LEAST_SIGHTS {
            return Self::default();
        }
        // Whole places are left out, before what is left takes any room.
        let some = sure.step_by(all.div_ceil(MOST_SIGHTS));
        let seen = some.flat_map(|(place, views)| views.into_iter().map(move |view| (view, place)));
        Self(seen.collect())
    }

    /// Whether none is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// A view's number and a place it sees.
    #[must_use]
    pub fn as_slice(&self) -> &[(u32, DVec3)] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use io_colmap::{Pose, SparsePoint, View};

    use super::*;

    #[test]
    fn points_that_enough_views_see_exactly_are_sights_of_those_views() {
        let view = |id| View {
            id,
            name: format!("{id}.png"),
            camera_id: 1,
            camera_from_world: Pose {
                rotation: DQuat::IDENTITY,
                translation: DVec3::ZERO,
            },
        };
        let point = |id: u64, error: f64, views: &[u32]| SparsePoint {
            id,
            position: DVec3::X * id as f64,
            colour: [0; 3],
            error,
            views: views.to_vec(),
        };
        let mut model = Model {
            views: [9, 4, 7].map(view).to_vec(),
            // Too few see it, and it is not exact.
            points: vec![point(1, 0.5, &[4, 9]), point(2, 2.5, &[4, 7, 9])],
            ..Model::default()
        };
        assert!(Sights::of_points(&model).is_empty());
        let exact = (3..60).map(|id| point(id, -1.0, &[4, 7, 9]));
        model.points.extend(exact);
        let sights = Sights::of_points(&model);
        let sights = sights.as_slice();
        assert_eq!(sights.len(), 3 * 57);
        let place = |id: f64| DVec3::X * id;
        let expected = [(1, 3.0), (2, 3.0), (0, 3.0), (1, 4.0)];
        assert_eq!(sights[..4], expected.map(|(view, id)| (view, place(id))));
    }
}
