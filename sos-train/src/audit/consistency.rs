//! Cross-view consistency: do neighbouring views call the same places the object?
//!
//! A cell of a view whose matte is at least one half has a place in space, by the view's own depth. That
//! place is **looked at** from the [`NEIGHBOURS`] views that stand closest, as seen from the middle of
//! the object. What is found there, within one cell (the outline falls between pixels):
//!
//! * the neighbour's matte is at least one half: the look **agrees**. What hides the place then is the
//!   object itself, or nothing does.
//! * it is less, and the neighbour's photo has about the colour of this one: it shows the same place and
//!   says something else. The look **objects**.
//! * it is less, and the colours differ: something stands in between. The look is left out, unless no
//!   neighbour at all agrees about the place: then there is nothing to stand behind, and it objects.
//!
//! ```text
//! consistency of a view = agreeing looks / (agreeing + objecting looks)
//! ```
//! over the looks from its own cells and those of its neighbours into it; the run's is the mean over views.
//! Mattes that are all wrong in the same way agree: consistency is necessary, not sufficient. The mattes of
//! a run come from one surface, so that theirs is close to 1 wherever they are sharp; the same score of the
//! start masks, carried by the same depths, says how far from that the run began.

use super::reduced::{HALF, Outline, ReducedView};
use glam::DVec3;

/// Views that look at a view's places, and into which they look.
const NEIGHBOURS: usize = 6;
/// Root mean square over the channels, of 255, up to which two photos show the same: light changes with
/// the direction, another object is something else.
const SAME_COLOUR: f32 = 30.0;

/// What was found at a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Vote {
    pub(super) agree: u32,
    pub(super) object: u32,
}

impl Vote {
    /// Share of looks that object, 0..1; 0 where nobody looked.
    pub(super) fn disagreement(self) -> f32 {
        self.object as f32 / (self.agree + self.object).max(1) as f32
    }

    /// Share of all looks that agree; `None` without any.
    pub(super) fn consistency(votes: &[Self]) -> Option<f64> {
        let (agree, object) = votes.iter().fold((0u64, 0u64), |(agree, object), vote| {
            (
                agree + u64::from(vote.agree),
                object + u64::from(vote.object),
            )
        });
        (agree + object > 0).then(|| agree as f64 / (agree + object) as f64)
    }
}

/// One place, one view.
enum Look {
    Agrees,
    Objects,
    /// Another colour.
    Differs,
}

/// For every view, the views that stand closest to it as seen from the middle of the object.
pub(super) fn neighbours(views: &[ReducedView]) -> Vec<Vec<usize>> {
    let middle = middle(views);
    let directions: Vec<DVec3> = views
        .iter()
        .map(|view| (view.camera_from_world.centre() - middle).normalize_or_zero())
        .collect();
    (0..views.len())
        .map(|i| {
            let mut others: Vec<usize> = (0..views.len()).filter(|&j| j != i).collect();
            // Equal angles keep the order of the model.
            others.sort_by(|&a, &b| {
                let angle = |j: usize| -directions[i].dot(directions[j]);
                angle(a).total_cmp(&angle(b))
            });
            others.truncate(NEIGHBOURS);
            others
        })
        .collect()
}

/// The mean of what all views see of the object; every so many cells are enough.
fn middle(views: &[ReducedView]) -> DVec3 {
    const EVERY: usize = 37;
    let (mut sum, mut count) = (DVec3::ZERO, 0u32);
    for view in views {
        let world_from_camera = view.camera_from_world.inverse();
        for cell in (0..view.alpha.len()).step_by(EVERY) {
            if let Some(point) = view.point(Outline::Matte, &world_from_camera, cell) {
                sum += point;
                count += 1;
            }
        }
    }
    sum / f64::from(count.max(1))
}

/// What the looks from view `i` at its `around`, and back, find: one vote per cell of view `i`. Views
/// without such an outline take no part.
pub(super) fn votes_in(
    views: &[ReducedView],
    i: usize,
    around: &[usize],
    by: Outline,
) -> Vec<Vote> {
    let own = &views[i];
    let mut votes = vec![Vote::default(); own.alpha.len()];
    let world_from_camera = own.camera_from_world.inverse();
    for (cell, slot) in votes.iter_mut().enumerate() {
        let Some(point) = own.point(by, &world_from_camera, cell) else {
            continue;
        };
        let (mut vote, mut differ) = (Vote::default(), 0);
        for &j in around {
            match look(own, cell, point, &views[j], by).map(|(_, look)| look) {
                Some(Look::Agrees) => vote.agree += 1,
                Some(Look::Objects) => vote.object += 1,
                Some(Look::Differs) => differ += 1,
                None => {}
            }
        }
        if vote.agree == 0 {
            vote.object += differ;
        }
        *slot = vote;
    }
    for &j in around {
        let other = &views[j];
        let world_from_camera = other.camera_from_world.inverse();
        for cell in 0..other.alpha.len() {
            let Some(point) = other.point(by, &world_from_camera, cell) else {
                continue;
            };
            match look(other, cell, point, own, by) {
                Some((at, Look::Agrees)) => votes[at].agree += 1,
                Some((at, Look::Objects)) => votes[at].object += 1,
                _ => {}
            }
        }
    }
    votes
}

/// Looks from view `to` at a place that view `from` shows in `cell`: the cell there, and what it says.
fn look(
    from: &ReducedView,
    cell: usize,
    point: DVec3,
    to: &ReducedView,
    by: Outline,
) -> Option<(usize, Look)> {
    let outline = to.outline(by);
    let at = to.cell(point).filter(|at| *at < outline.len())?;
    if to.around(at).any(|near| outline[near] >= HALF) {
        return Some((at, Look::Agrees));
    }
    let colour = from.photo[cell];
    let alike = to.around(at).any(|near| {
        let squares: f32 = (0..3)
            .map(|c| f32::from(colour[c]) - f32::from(to.photo[near][c]))
            .map(|difference| difference * difference)
            .sum();
        squares <= 3.0 * SAME_COLOUR * SAME_COLOUR
    });
    Some((at, if alike { Look::Objects } else { Look::Differs }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::squares::Squares;
    use glam::DQuat;
    use io_colmap::{Camera, CameraModel, Pose};

    #[test]
    fn many_cells_of_a_close_up_may_fall_into_one() {
        let vote = Vote {
            agree: 40_000,
            object: 40_000,
        };
        assert_eq!(vote.disagreement(), 0.5);
    }

    /// Cameras in a row look at a red square, 8 cells wide at depth 4, on a blue wall right behind.
    fn views(count: usize) -> Vec<ReducedView> {
        (0..count)
            .map(|i| {
                let (width, height) = (32usize, 24usize);
                let inside = |cell: usize| {
                    let x = (cell % width) as f64 + 0.5 + i as f64;
                    let y = (cell / width) as f64 + 0.5;
                    (12.0..20.0).contains(&x) && (8.0..16.0).contains(&y)
                };
                let cells = || 0..width * height;
                ReducedView {
                    name: i.to_string(),
                    camera: Camera {
                        id: 1,
                        model: CameraModel::Pinhole,
                        width: 32,
                        height: 24,
                        params: vec![40.0, 40.0, 16.0, 12.0],
                    },
                    camera_from_world: Pose {
                        rotation: DQuat::IDENTITY,
                        // A tenth of a unit at depth 4 is one pixel.
                        translation: DVec3::new(-0.1 * i as f64, 0.0, 0.0),
                    },
                    squares: Squares::of_side(32, 24, 1),
                    alpha: cells().map(|c| if inside(c) { 255 } else { 0 }).collect(),
                    depth: cells().map(|c| if inside(c) { 4.0 } else { 0.0 }).collect(),
                    photo: cells()
                        .map(|c| if inside(c) { [200, 0, 0] } else { [0, 0, 200] })
                        .collect(),
                    mask: Vec::new(),
                    mask_iou: None,
                }
            })
            .collect()
    }

    fn votes(views: &[ReducedView], i: usize) -> Vec<Vote> {
        votes_in(views, i, &neighbours(views)[i], Outline::Matte)
    }

    fn consistency(views: &[ReducedView], i: usize) -> Option<f64> {
        Vote::consistency(&votes(views, i))
    }

    #[test]
    fn neighbours_are_the_closest() {
        let around = neighbours(&views(9));
        assert_eq!(around[0], [1, 2, 3, 4, 5, 6]);
        assert_eq!(around[8].first(), Some(&7));
    }

    #[test]
    fn mattes_of_one_square_agree() {
        let views = views(4);
        assert!((0..4).all(|i| consistency(&views, i) == Some(1.0)));
        // A view without anything in it says nothing.
        let mut empty = views;
        for view in &mut empty {
            view.alpha.fill(0);
        }
        assert_eq!(consistency(&empty, 0), None);
    }

    #[test]
    fn a_hole_in_one_matte_is_found_in_its_view_first() {
        let mut views = views(4);
        let hole = |x: usize, y: usize| (12..16).contains(&x) && (8..16).contains(&y);
        for cell in 0..views[1].alpha.len() {
            if hole(cell % 32, cell / 32) {
                views[1].alpha[cell] = 0;
            }
        }
        let own = consistency(&views, 1).unwrap_or(1.0);
        let other = consistency(&views, 3).unwrap_or(1.0);
        assert!(own < 0.9 && own < other && other < 1.0, "{own} {other}");
        let votes = votes(&views, 1);
        assert!(votes[10 * 32 + 13].disagreement() == 1.0);
        assert!(votes[10 * 32 + 17].disagreement() == 0.0);
    }

    #[test]
    fn what_stands_before_the_object_is_no_objection_and_a_floater_is() {
        let mut views = views(4);
        // A green bar before half of the square, seen by view 3 alone.
        for cell in 0..views[3].alpha.len() {
            if cell % 32 < 13 {
                (views[3].alpha[cell], views[3].photo[cell]) = (0, [0, 200, 0]);
            }
        }
        assert_eq!(consistency(&views, 3), Some(1.0));
        // A piece of the wall that view 0 calls the object.
        let mut floater = views;
        for cell in 0..floater[0].alpha.len() {
            if cell / 32 < 4 && cell % 32 > 26 {
                (floater[0].alpha[cell], floater[0].depth[cell]) = (255, 4.0);
            }
        }
        assert!(consistency(&floater, 0).unwrap_or(1.0) < 0.95);
    }
}
