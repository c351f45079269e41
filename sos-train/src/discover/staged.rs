//! For tests: cameras around balls on a table, before a wall perhaps, and boxes of voxels.

#![allow(clippy::unwrap_used)]

use glam::{DMat3, DQuat, DVec3, Vec2, Vec3};
use image::{Rgb, RgbImage};
use io_colmap::{Camera, CameraModel, Pose};
use neus_render::rays::Ray;

use crate::prepare::view::Lens;
use crate::prepare::{Frame, TrainView, balls};
use crate::train::carve::depth::DepthPicture;

/// The table's colour.
pub(super) const TABLE: [u8; 3] = [90, 80, 70];
/// The side of a square of the table or the wall.
const SQUARE: f32 = 0.1;
/// The wall's colour.
const WALL: [u8; 3] = [120, 130, 150];
/// The photos' width and height.
const SIDE: u32 = 120;
/// The frame of the world itself.
const WORLD: Frame = Frame {
    centre: DVec3::ZERO,
    half_side: 1.0,
};

/// For each voxel of `n^3` the number, from 1 on, of the first of the boxes `[low, high)` along x, y and z that holds it; 0 is none.
pub(super) fn labelled_boxes(boxes: &[[[usize; 2]; 3]], n: usize) -> Vec<u32> {
    let label = |cell: usize| {
        let at = [cell % n, cell / n % n, cell / (n * n)];
        let holds = |of: &[[usize; 2]; 3]| {
            let mut axes = at.iter().zip(of);
            axes.all(|(at, [low, high])| (low..high).contains(&at))
        };
        boxes.iter().position(holds).map_or(0, |i| i as u32 + 1)
    };
    (0..n.pow(3)).map(label).collect()
}

/// A ball of one colour.
pub(super) struct Ball {
    pub(super) centre: Vec3,
    pub(super) radius: f32,
    pub(super) colour: [u8; 3],
}

/// Balls on a table, which is at a height, before a wall that faces along -y.
pub(super) struct Stage {
    pub(super) table: f32,
    /// Where it is along y; infinity is nowhere.
    pub(super) wall: f32,
    /// Table and wall are of squares of two shades: what is all of one has no edge anywhere.
    pub(super) is_checkered: bool,
    pub(super) balls: Vec<Ball>,
}

impl Stage {
    /// The distance to what a ray of the world meets, and its colour.
    fn meet(&self, ray: &Ray) -> (f32, [u8; 3]) {
        let table = (self.table - ray.origin.z) / ray.direction.z.min(-1e-6);
        let balls = self.balls.iter().filter_map(|ball| {
            let to = ball.centre - ray.origin;
            let along = to.dot(ray.direction);
            let inside = ball.radius * ball.radius - to.length_squared() + along * along;
            (inside > 0.0).then(|| (along - inside.sqrt(), ball.colour))
        });
        let wall = (self.wall - ray.origin.y) / ray.direction.y.max(1e-6);
        let behind = [(table, TABLE), (wall, WALL)];
        let shade = |(distance, colour): (f32, [u8; 3])| {
            let squares = ((ray.origin + distance * ray.direction) / SQUARE).floor();
            let is_dark = squares.element_sum().rem_euclid(2.0) < 1.0;
            let is_dark = self.is_checkered && is_dark;
            (
                distance,
                if is_dark {
                    colour.map(|v| v / 2)
                } else {
                    colour
                },
            )
        };
        let all = balls.chain(behind.map(shade));
        all.fold((f32::INFINITY, WALL), |a, b| if b.0 < a.0 { b } else { a })
    }

    /// How far a point is outside of everything.
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        let balls = self.balls.iter();
        balls
            .map(|ball| point.distance(ball.centre) - ball.radius)
            .fold((point.z - self.table).min(self.wall - point.y), f32::min)
    }

    /// A photo from a place that looks at the middle.
    pub(super) fn photo(&self, from: DVec3) -> TrainView {
        let z = -from.normalize();
        let x = z.cross(DVec3::Z).normalize();
        let rotation = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z)).inverse();
        let half = f64::from(SIDE) / 2.0;
        let mut view = TrainView {
            lens: Lens(Camera {
                id: 1,
                model: CameraModel::Pinhole,
                width: SIDE,
                height: SIDE,
                params: vec![130.0, 130.0, half, half],
            }),
            camera_from_world: Pose {
                rotation,
                translation: -(rotation * from),
            },
            ..balls::view(from, -from)
        };
        let pose = view.world_from_camera(&WORLD);
        let photo = RgbImage::from_fn(SIDE, SIDE, |x, y| {
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            Rgb(self.meet(&view.ray(&pose, pixel).unwrap()).1)
        });
        view.photo = view.store.keep_photo(photo).unwrap();
        view
    }

    /// The depths that a photo shows, in a frame.
    pub(super) fn depths(&self, view: &TrainView, frame: &Frame) -> DepthPicture {
        let pose = view.world_from_camera(&WORLD);
        let mut picture = DepthPicture {
            stride: 1,
            width: view.width(),
            distances: vec![f32::INFINITY; (SIDE * SIDE) as usize],
        };
        for i in 0..picture.distances.len() {
            let ray = view.ray(&pose, picture.pixel(i)).unwrap();
            picture.distances[i] = self.meet(&ray).0 / frame.half_side as f32;
        }
        picture
    }
}
