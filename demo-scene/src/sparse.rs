//! Sparse points with tracks, as structure from motion would leave them, but exact.

use glam::{DVec2, DVec3};
use image::RgbImage;

use crate::camera::Camera;
use crate::config::DemoConfig;
use crate::kind::SceneKind;
use crate::noise::Rng;
use crate::prop::Thing;
use crate::room::Furniture;
use crate::stage::{Hit, Seen, Stage, TABLE_CENTRE, TARGET};

/// Where a point appears in one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the view.
    pub view: usize,
    /// Pixel coordinates: the exact projection of the point.
    pub pixel: DVec2,
}

/// A point on a surface and the views that see it.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// World coordinates, metres.
    pub position: DVec3,
    /// sRGB colour in the first view that sees it.
    pub color: [u8; 3],
    /// At least three, in order of view.
    pub observations: Vec<Observation>,
}

/// Shares of the points: target, clutter, table top, everything else.
fn shares(kind: SceneKind) -> [f64; 4] {
    match kind {
        SceneKind::Can | SceneKind::OneSide | SceneKind::Thin | SceneKind::Apart => {
            [0.32, 0.28, 0.20, 0.20]
        }
        // Structure from motion finds next to nothing where nothing has texture.
        SceneKind::Plain => [0.03, 0.0, 0.01, 0.96],
        // What does not turn is nowhere for structure from motion.
        SceneKind::Turntable => [0.6, 0.4, 0.0, 0.0],
    }
}

const SHORTEST_TRACK: usize = 3;
/// A traced ray stops within 0.1 mm of a surface; seen at the least cosine that is half a
/// millimetre along the ray, doubled for curvature.
const LEAST_COSINE: f64 = 0.2;
const VISIBLE_WITHIN: f64 = 1e-3;

fn class(stage: &Stage, hit: &Hit) -> usize {
    match hit.prop.map(|index| &stage.props[index].thing) {
        Some(Thing::Target(_)) => 0,
        Some(Thing::Clutter(_)) => 1,
        Some(Thing::Furniture(Furniture::TableTop(_))) => 2,
        _ => 3,
    }
}

/// Draws up to as many points as are wanted, through random pixels of random views.
pub(crate) fn sparse_points(
    stage: &Stage,
    cameras: &[Camera],
    photos: &[&RgbImage],
    config: &DemoConfig,
) -> Vec<SparsePoint> {
    debug_assert_eq!(TARGET, 0);
    let (wanted, seed) = (config.sparse_points, config.seed);
    let mut rng = Rng::new(seed, 0x5fa6);
    let mut room = shares(config.kind).map(|share| (share * wanted as f64).ceil() as usize);
    let mut points = Vec::with_capacity(wanted);
    for attempt in 0..wanted * 60 {
        if points.len() >= wanted || cameras.is_empty() {
            break;
        }
        let camera = &cameras[attempt % cameras.len()];
        let pixel = DVec2::new(
            rng.range(0.0, f64::from(camera.width)),
            rng.range(0.0, f64::from(camera.height)),
        );
        let eye = camera.centre() - TABLE_CENTRE;
        let hit = stage.trace(eye, camera.ray(pixel), Seen::Everything);
        let class = class(stage, &hit);
        if room[class] == 0 {
            continue;
        }
        // Two Newton steps put the point on the surface to rounding error.
        let mut p = hit.point;
        for _ in 0..2 {
            p -= hit.normal * stage.distance(hit.prop, p);
        }
        if stage.distance(hit.prop, p).abs() > 1e-6 {
            continue;
        }
        let observations: Vec<Observation> = cameras
            .iter()
            .enumerate()
            .filter_map(|(view, camera)| {
                observe(stage, camera, p, hit.normal).map(|pixel| Observation { view, pixel })
            })
            .collect();
        let Some(first) = observations
            .first()
            .filter(|_| observations.len() >= SHORTEST_TRACK)
        else {
            continue;
        };
        let color = photos[first.view]
            .get_pixel(first.pixel.x as u32, first.pixel.y as u32)
            .0;
        room[class] -= 1;
        points.push(SparsePoint {
            position: p + TABLE_CENTRE,
            color,
            observations,
        });
    }
    points
}

/// Pixel at which a camera sees the stage point `p` with normal `n`, if it does.
fn observe(stage: &Stage, camera: &Camera, p: DVec3, n: DVec3) -> Option<DVec2> {
    let (pixel, _) = camera.project(p + TABLE_CENTRE)?;
    let eye = camera.centre() - TABLE_CENTRE;
    let to_eye = eye - p;
    let distance = to_eye.length();
    if !camera.contains(pixel) || n.dot(to_eye) < LEAST_COSINE * distance {
        return None;
    }
    let hit = stage.trace(eye, -to_eye / distance, Seen::Everything);
    ((hit.t - distance).abs() < VISIBLE_WITHIN).then_some(pixel)
}
