//! Humps of the ground: what a short search takes for low things on it.
//!
//! Where few views look, or all of them show one colour, surfaces learnt in a short time bulge. Photos tell a bulge from a
//! low thing: a pixel that shows the bulge in truth shows the ground behind it, and the other views show that very place,
//! bare, in the same colour.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::columns::Columns;
use super::plane::Plane;
use crate::prepare::{Frame, TrainView};
use crate::train::carve::depth::DepthPicture;

/// Views that are asked for a bare place's colour: of hundreds every few do.
const MOST_WITNESSES: usize = 64;
/// Heights above the ground up to which a column may be a hump, in the normalised frame.
const LOW: f32 = 0.2;
/// Voxels by which a point may lie before or behind what a view shows at its pixel, to be what it shows.
const SEEN_WITHIN: f32 = 2.0;
/// How far colours may be apart to be the same, of sRGB in `[0, 1]`.
const SAME_COLOUR: f32 = 0.12;
/// Share of pairs of views, one that shows a point and one that sees the ground behind it, that must show one colour.
const AGREEING: f32 = 0.5;
/// Share of a column's points of which that must hold for it to be a hump.
const BARE: f32 = 0.4;

/// Takes humps of the `ground` away from the fused distances `solid` `[resolution^3]`: nothing is above it there any more.
pub(super) fn flatten(solid: &mut [f32], resolution: usize, ground: &Plane, eyes: &Eyes) {
    let outside = solid.iter().copied().fold(0.0, f32::max);
    let columns = Columns::new(ground, resolution);
    let heights = columns.heights(solid);
    let bare = columns.bare_colours(&heights, eyes);
    let pitch = 2.0 / resolution as f32;
    // For each column, of how many points something is known, and how many of them look like the ground behind them.
    let verdicts: Vec<(usize, bool)> = (0..solid.len())
        .into_par_iter()
        .filter_map(|cell| {
            let point = ProbabilityMap::centre(resolution, cell);
            let column = columns.of(point)?;
            let above = !ground.has(point);
            let is_surface = solid[cell] < 0.0 && solid[cell] > -pitch;
            if !(above && is_surface && heights[column] <= LOW) {
                return None;
            }
            let (mut asked, mut agreeing) = (0, 0);
            for (Witness { view, colour }, behind) in
                eyes.behind(point, SEEN_WITHIN * pitch, ground)
            {
                let Some(place) = columns.of(behind) else {
                    continue;
                };
                for other in bare[place].iter().filter(|other| other.view != view) {
                    asked += 1;
                    agreeing += usize::from(other.shows_as(colour));
                }
            }
            (asked > 0).then_some((column, agreeing as f32 >= AGREEING * asked as f32))
        })
        .collect();
    let mut counts = vec![[0u32; 2]; heights.len()];
    for (column, looks_bare) in verdicts {
        counts[column][usize::from(looks_bare)] += 1;
    }
    let humps: Vec<bool> = (0..counts.len())
        .map(|column| {
            let [other, bare] = counts[column];
            bare > 0 && bare as f32 >= BARE * (bare + other) as f32
        })
        .collect();
    for (cell, distance) in solid.iter_mut().enumerate() {
        let point = ProbabilityMap::centre(resolution, cell);
        if !ground.has(point) && columns.of(point).is_some_and(|column| humps[column]) {
            *distance = outside;
        }
    }
}

impl Columns<'_> {
    /// Where a column meets the ground.
    fn foot(&self, column: usize) -> Vec3 {
        let along =
            |at: usize| (at as f32 + 0.5 - 0.5 * self.side as f32) * 2.0 / self.resolution as f32;
        let [u, v] = self.along;
        along(column % self.side) * u
            + along(column / self.side) * v
            + self.ground.offset * self.ground.normal
    }

    /// How high above the ground each column is solid; 0 where it is bare.
    fn heights(&self, solid: &[f32]) -> Vec<f32> {
        let mut heights = vec![0.0f32; self.side * self.side];
        for (cell, _) in solid.iter().enumerate().filter(|(_, d)| **d < 0.0) {
            let point = ProbabilityMap::centre(self.resolution, cell);
            let height = self.ground.height(point);
            if height > self.ground.thickness
                && let Some(column) = self.of(point)
            {
                heights[column] = heights[column].max(height);
            }
        }
        heights
    }

    /// The views that see the ground where a column is bare, and in which colour.
    fn bare_colours(&self, heights: &[f32], eyes: &Eyes) -> Vec<Vec<Witness>> {
        (0..heights.len())
            .into_par_iter()
            .map(|column| {
                let foot = self.foot(column);
                if heights[column] > 0.0 || self.of(foot).is_none() {
                    return Vec::new();
                }
                let hidden_by = 2.0 * self.ground.thickness;
                let sees = |(_, before): &(Witness, f32)| *before > -hidden_by;
                let seen: Vec<Witness> = eyes
                    .looking_at(foot)
                    .filter(sees)
                    .map(|(witness, _)| witness)
                    .collect();
                let each = seen.len().div_ceil(MOST_WITNESSES).max(1);
                seen.into_iter().step_by(each).collect()
            })
            .collect()
    }
}

/// All views, with what they show.
pub(super) struct Eyes<'a> {
    views: &'a [TrainView],
    frame: &'a Frame,
    depths: &'a [DepthPicture],
    origins: Vec<Vec3>,
}

impl<'a> Eyes<'a> {
    /// Of all views, with the distances that each shows in the normalised `frame`.
    pub(super) fn new(
        views: &'a [TrainView],
        frame: &'a Frame,
        depths: &'a [DepthPicture],
    ) -> Self {
        let origin = |view: &TrainView| view.camera_centre(frame);
        Self {
            views,
            frame,
            depths,
            origins: views.iter().map(origin).collect(),
        }
    }

    /// The views that have a point in the picture, and how far it is before what each shows at its pixel.
    fn looking_at(&self, point: Vec3) -> impl Iterator<Item = (Witness, f32)> {
        let world = self.frame.world_from_normalised(point);
        let views = self.views.iter().zip(self.depths).enumerate();
        views.filter_map(move |(i, (view, depth))| {
            let (pixel, _) = view.project(world)?;
            let before = depth.at(pixel) - point.distance(self.origins[i]);
            Some((Witness::new(i, view, pixel), before))
        })
    }

    /// The views that show a point of a surface, and where the rays that go on behind it meet the ground.
    fn behind(
        &self,
        point: Vec3,
        within: f32,
        ground: &Plane,
    ) -> impl Iterator<Item = (Witness, Vec3)> {
        self.looking_at(point).filter_map(move |(witness, before)| {
            let origin = self.origins[witness.view as usize];
            let (start, height) = (ground.height(origin), ground.height(point));
            let behind = origin + (point - origin) * (start / (start - height));
            // Beside the outline of what is low, a pixel may show the ground itself that close.
            let nearest = before < 0.5 * behind.distance(point);
            (start > height && before.abs() <= within && nearest).then_some((witness, behind))
        })
    }
}

/// A view of a place, and the colour it is seen in, 8-bit sRGB: there are as many as columns times views.
#[derive(Clone, Copy)]
struct Witness {
    view: u32,
    colour: [u8; 3],
}

impl Witness {
    fn new(number: usize, view: &TrainView, pixel: Vec2) -> Self {
        let x = (pixel.x as u32).min(view.width() - 1);
        let y = (pixel.y as u32).min(view.height() - 1);
        Self {
            view: number as u32,
            colour: view.photo.get_pixel(x, y).0,
        }
    }

    /// Whether this is the same colour.
    fn shows_as(&self, colour: [u8; 3]) -> bool {
        let of = |colour: [u8; 3]| Vec3::from_array(colour.map(|v| f32::from(v) / 255.0));
        of(self.colour).distance(of(colour)) <= SAME_COLOUR
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::staged::{Ball, Stage, TABLE};
    use super::*;

    const N: usize = 64;
    const GROUND: Plane = Plane {
        normal: Vec3::Z,
        offset: -0.4,
        thickness: 0.03,
    };
    /// What is beside the middle to both sides: a thing of another colour, and a hump of the ground's.
    const THING: Vec3 = Vec3::new(-0.4, 0.0, -0.45);
    const HUMP: Vec3 = Vec3::new(0.4, 0.0, -0.45);
    const RADIUS: f32 = 0.2;

    #[test]
    fn a_hump_is_taken_away_and_a_thing_of_another_colour_stays() {
        let frame = Frame {
            centre: DVec3::ZERO,
            half_side: 1.0,
        };
        let ball = |centre, colour| Ball {
            centre,
            radius: RADIUS,
            colour,
        };
        let photographed = Stage {
            table: GROUND.offset,
            wall: f32::INFINITY,
            is_checkered: false,
            balls: vec![ball(THING, [200, 60, 40])],
        };
        // As it was learnt.
        let stage = Stage {
            table: GROUND.offset,
            wall: f32::INFINITY,
            is_checkered: false,
            balls: vec![ball(THING, [200, 60, 40]), ball(HUMP, TABLE)],
        };
        let views: Vec<TrainView> = (0..12)
            .map(|i| 0.52 * f64::from(i))
            .map(|angle| DVec3::new(2.5 * angle.cos(), 2.5 * angle.sin(), 1.6))
            .map(|from| photographed.photo(from))
            .collect();
        let depths: Vec<DepthPicture> = views
            .iter()
            .map(|view| stage.depths(view, &frame))
            .collect();
        let mut solid: Vec<f32> = (0..N.pow(3))
            .map(|cell| stage.distance(ProbabilityMap::centre(N, cell)))
            .collect();
        let before = solid.clone();
        flatten(&mut solid, N, &GROUND, &Eyes::new(&views, &frame, &depths));
        let above = |solid: &[f32], at: Vec3| {
            (0..solid.len())
                .filter(|&cell| {
                    let p = ProbabilityMap::centre(N, cell);
                    solid[cell] < 0.0 && !GROUND.has(p) && p.distance(at) < 2.0 * RADIUS
                })
                .count()
        };
        let kept = above(&solid, THING) as f32 / above(&before, THING) as f32;
        // A pixel at its outline may show the ground beside it.
        assert!(kept > 0.8, "{kept} of the thing is kept");
        let left = above(&solid, HUMP) as f32 / above(&before, HUMP) as f32;
        assert!(left < 0.1, "{left} of the hump is left");
        // The ground itself stays.
        let ground = |solid: &[f32]| {
            let low = |cell: &usize| GROUND.height(ProbabilityMap::centre(N, *cell)) < 0.0;
            (0..solid.len())
                .filter(low)
                .all(|cell| solid[cell] == before[cell])
        };
        assert!(ground(&solid));
    }
}
