//! Where some rays are known to end.
//!
//! A sparse point was matched between the photos that show it, so that nothing stands before it in any of them. Learnt
//! with few views, a field has floaters and bulges that all photos can be explained with; where their rays are known to
//! end it has not (Deng et al. 2022, "Depth-supervised NeRF: Fewer Views and Faster Training for Free").

use std::collections::HashMap;

use glam::DVec3;
use io_colmap::Model;

/// Pixels of reprojection error up to which a point is where it is said to be.
const MOST_ERROR: f64 = 2.0;
/// Views that have to see a point: two can be mistaken together.
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
        let exact = model
            .points
            .iter()
            .filter(|point| point.error <= MOST_ERROR && point.views.len() >= LEAST_VIEWS);
        Self::new(exact.flat_map(|point| {
            let numbers = point.views.iter().filter_map(|id| number.get(id).copied());
            numbers.map(|view| (view, point.position))
        }))
    }

    /// Of views, by number, and places they see; none where these are too few.
    #[must_use]
    pub fn new(seen: impl IntoIterator<Item = (u32, DVec3)>) -> Self {
        let all: Vec<(u32, DVec3)> = seen.into_iter().collect();
        if all.len() < LEAST_SIGHTS {
            return Self::default();
        }
        let stride = all.len().div_ceil(MOST_SIGHTS);
        Self(all.into_iter().step_by(stride).collect())
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
            // Too few of them see it, it is not exact, and 5 is no view of the model.
            points: vec![
                point(1, 0.5, &[4, 9]),
                point(2, 2.5, &[4, 7, 9]),
                point(3, 0.5, &[4, 5, 9]),
            ],
            ..Model::default()
        };
        assert_eq!(Sights::of_points(&model), Sights::default());
        model
            .points
            .extend((4..60).map(|id| point(id, -1.0, &[4, 7, 9])));
        let sights = Sights::of_points(&model);
        let sights = sights.as_slice();
        assert_eq!(sights.len(), 2 + 3 * 56);
        let place = |id: f64| DVec3::X * id;
        let expected = [(1, place(3.0)), (0, place(3.0)), (1, place(4.0))];
        assert_eq!(sights[..3], expected);
    }
}
