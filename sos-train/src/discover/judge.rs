//! What the mask of one view says of points that others show.

use glam::{Vec2, Vec3};

use crate::prepare::mask::Mask;
use crate::prepare::{Frame, Prepared, TrainView};
use crate::train::carve::depth::DepthPicture;

/// Voxels by which a point may lie before or behind what a masked view shows at its pixel, to be what it shows.
const SEEN_WITHIN: f32 = 2.0;
/// How near to a mask's edge a pixel is not sure, as a share of the picture's diagonal.
const UNSURE: f32 = 0.01;
/// What a pixel there counts.
const UNSURE_WEIGHT: f32 = 0.1;

/// What a masked view says of a point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Saying {
    /// How sure it is the object.
    pub(super) inside: f32,
    /// How sure it is not.
    pub(super) outside: f32,
    /// Whether it is hidden there by what is not the object.
    pub(super) aside: bool,
}

/// One masked view.
pub(super) struct Judge<'a> {
    view: &'a TrainView,
    mask: &'a Mask,
    depth: &'a DepthPicture,
    frame: &'a Frame,
    origin: Vec3,
    within: f32,
    unsure: f32,
}

impl<'a> Judge<'a> {
    /// Of the `mask` of a view, by its number in `data`, that shows `depth`.
    pub(super) fn new(
        view: usize,
        mask: &'a Mask,
        depth: &'a DepthPicture,
        data: &'a Prepared,
    ) -> Self {
        let view = &data.views[view];
        let diagonal = (view.width() as f32).hypot(view.height() as f32);
        Self {
            view,
            mask,
            depth,
            frame: &data.frame,
            origin: view.camera_centre(&data.frame),
            within: SEEN_WITHIN * 2.0 / data.map.resolution() as f32,
            unsure: UNSURE * diagonal,
        }
    }

    /// What it says of a point: nothing of one that it sees past, for that is noise, or learnt a little off the place at
    /// which its outline passes it.
    pub(super) fn of(&self, point: Vec3) -> Saying {
        let world = self.frame.world_from_normalised(point);
        let Some((pixel, _)) = self.view.project(world) else {
            return Saying::default();
        };
        if self.view.ignores(pixel.x as u32, pixel.y as u32) {
            return Saying::default();
        }
        let before = self.depth.at(pixel) - point.distance(self.origin);
        if before.is_nan() || before > self.within {
            return Saying::default();
        }
        let white = self.white(pixel);
        let sure = [Vec2::X, Vec2::Y, Vec2::NEG_X, Vec2::NEG_Y]
            .iter()
            .all(|way| self.white(pixel + self.unsure * *way) == white);
        if before < -self.within {
            return Saying {
                aside: sure && !white,
                ..Saying::default()
            };
        }
        let weight = if sure { 1.0 } else { UNSURE_WEIGHT };
        Saying {
            inside: if white { weight } else { 0.0 },
            outside: if white { 0.0 } else { weight },
            aside: false,
        }
    }

    /// Whether its mask is white at a pixel, or the nearest one in the picture.
    fn white(&self, pixel: Vec2) -> bool {
        let last = Vec2::new(self.mask.width() as f32, self.mask.height() as f32) - 1.0;
        let at = pixel.clamp(Vec2::ZERO, last);
        self.mask.contains(at.x as u32, at.y as u32)
    }
}
