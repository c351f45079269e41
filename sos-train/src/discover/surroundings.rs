//! Surroundings without an edge: a black room, a white table, a clear sky.
//!
//! Nothing can be learnt of where they are, so that they end up anywhere, beside the object too. But photos tell them: zones of
//! one colour that go on to the picture's side ([`flat_zones`](crate::flat_zones)).

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use crate::cells::grown;
use crate::flat_zones::{self, flat_zones};
use crate::prepare::{Frame, Prepared, TrainView};
use crate::squares::Squares;
use crate::train::carve::depth::DepthPicture;
use crate::train::carve::fusion::seen_surface;

/// Voxels by which a point may lie before or behind what a view shows at its pixel, to be what it shows.
const SEEN_WITHIN: f32 = 1.5;
/// Share of the views that see a voxel that must show it in such a zone.
const AGREEING: f32 = 0.7;

/// Which voxels of the fused surface `solid`, of as many as the map of `data` has, most views show as surroundings without an
/// edge; none where a view's pixel that is `clicked` on is such a place.
pub(super) fn open_voxels(
    solid: &[f32],
    data: &Prepared,
    depths: &[DepthPicture],
    clicked: Option<(usize, Vec2)>,
) -> Vec<bool> {
    let resolution = data.map.resolution();
    let witnesses: Vec<Witness> = data
        .views
        .par_iter()
        .zip(depths)
        .map(|(view, depth)| Witness::new(view, depth, &data.frame))
        .collect();
    if clicked.is_some_and(|(view, pixel)| witnesses[view].open.holds(pixel)) {
        return vec![false; solid.len()];
    }
    let on_surface = seen_surface(solid);
    let reach = SEEN_WITHIN * 2.0 / resolution as f32;
    let is_open = |(cell, distance): (usize, &f32)| {
        if !on_surface(*distance) {
            return false;
        }
        let point = ProbabilityMap::centre(resolution, cell);
        let world = data.frame.world_from_normalised(point);
        let shown = witnesses.iter().filter_map(|witness| {
            let (pixel, _) = witness.view.project(world)?;
            let before = witness.depth.at(pixel) - point.distance(witness.origin);
            (before.abs() <= reach).then(|| witness.open.holds(pixel))
        });
        let (seen, open) = shown.fold((0, 0), |(seen, open), holds| {
            (seen + 1, open + usize::from(holds))
        });
        open > 0 && open as f32 >= AGREEING * seen as f32
    };
    solid.par_iter().enumerate().map(is_open).collect()
}

/// A view and what it shows.
struct Witness<'a> {
    view: &'a TrainView,
    depth: &'a DepthPicture,
    origin: Vec3,
    open: Open,
}

impl<'a> Witness<'a> {
    fn new(view: &'a TrainView, depth: &'a DepthPicture, frame: &Frame) -> Self {
        Self {
            view,
            depth,
            origin: view.camera_centre(frame),
            open: Open::of(view),
        }
    }
}

/// The zones of one colour that go on to a photo's side.
struct Open {
    squares: Squares,
    inside: Vec<bool>,
}

impl Open {
    fn of(view: &TrainView) -> Self {
        let squares = flat_zones::squares(view);
        let (columns, rows) = (squares.columns as usize, squares.rows as usize);
        let colours = flat_zones::colours(view, &squares);
        let at_side = |i: &usize| {
            let (x, y) = (i % columns, i / columns);
            x == 0 || y == 0 || x + 1 == columns || y + 1 == rows
        };
        let mut inside = vec![false; colours.len()];
        for zone in flat_zones(&colours, columns) {
            if zone.iter().any(at_side) {
                zone.into_iter().for_each(|i| inside[i] = true);
            }
        }
        // What is beside a zone's squares is like them, or they were not flat.
        let inside = grown(&inside, columns, 1);
        Self { squares, inside }
    }

    /// Whether a pixel of the photo is in one.
    fn holds(&self, pixel: Vec2) -> bool {
        let (x, y) = (pixel.x.max(0.0) as u32, pixel.y.max(0.0) as u32);
        self.inside.get(self.squares.of(x, y)) == Some(&true)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;

    use super::super::look::prepared;
    use super::super::staged::{Ball, Stage};
    use super::*;
    use crate::config::{Preset, TrainConfig};
    use crate::train::carve::fusion::fuse;

    #[test]
    fn a_plain_table_is_open_and_what_stands_on_it_is_not() {
        let (ball, radius) = (Vec3::new(0.1, 0.0, 0.0), 0.3);
        let stage = Stage {
            table: -0.3,
            wall: f32::INFINITY,
            is_checkered: false,
            balls: vec![Ball {
                centre: ball,
                radius,
                colour: [200, 60, 40],
            }],
        };
        let views: Vec<TrainView> = (0..12)
            .map(|i| 0.52 * f64::from(i))
            .map(|angle| stage.photo(DVec3::new(2.5 * angle.cos(), 2.5 * angle.sin(), 1.5)))
            .collect();
        let frame = Frame {
            centre: DVec3::ZERO,
            half_side: 0.8,
        };
        let data = prepared(&views, frame, &TrainConfig::preset(Preset::Default));
        let depths: Vec<DepthPicture> = views.iter().map(|v| stage.depths(v, &frame)).collect();
        let solid = fuse(&data, &depths, &data.map, 0.5, f32::INFINITY);
        let world = |cell: usize| {
            let point = ProbabilityMap::centre(data.map.resolution(), cell);
            frame.world_from_normalised(point).as_vec3()
        };
        let surface = |cell: &usize| stage.distance(world(*cell)).abs() < 0.006;
        let on_ball = |cell: &usize| world(*cell).distance(ball) < radius + 0.006;
        let open = open_voxels(&solid, &data, &depths, None);
        let share = |on: &dyn Fn(&usize) -> bool| {
            let cells = (0..solid.len()).filter(|cell| solid[*cell] < 0.0);
            let cells: Vec<usize> = cells.filter(surface).filter(|cell| on(cell)).collect();
            assert!(cells.len() > 500, "{}", cells.len());
            cells.iter().filter(|cell| open[**cell]).count() as f32 / cells.len() as f32
        };
        let (table, object) = (share(&|cell| !on_ball(cell)), share(&on_ball));
        assert!(table > 0.8 && object < 0.05, "{table}, {object}");
        // A click on the table says that it is the object.
        let clicked = open_voxels(&solid, &data, &depths, Some((0, Vec2::new(3.0, 110.0))));
        assert!(clicked.iter().all(|open| !open));
    }
}
