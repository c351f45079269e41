//! Where the photographs are taken from: once around the table, or from one side of it, handheld, or from three
//! stands before a turntable.

use glam::DVec3;

use crate::camera::Camera;
use crate::config::DemoConfig;
use crate::kind::SceneKind;
use crate::noise::Rng;
use crate::stage::{Stage, TABLE_CENTRE, TARGET};

/// Focal length in image widths: a horizontal field of view of about 48 degrees.
const FOCAL_PER_WIDTH: f64 = 1.12;

/// One photograph.
pub(crate) struct Shot {
    /// In the world, which is still where the target is.
    pub(crate) camera: Camera,
    /// In the room, where light and furniture stay.
    pub(crate) in_room: Camera,
    /// How far what can turn has turned in its room, radians about z.
    pub(crate) turn: f64,
}

/// The photographs of a scene, in order around the target, or from left to right.
pub(crate) fn shots(stage: &Stage, config: &DemoConfig) -> Vec<Shot> {
    if config.kind == SceneKind::Turntable {
        return before_a_turntable(stage, config);
    }
    let still = |camera| Shot {
        camera,
        in_room: camera,
        turn: 0.0,
    };
    handheld(stage, config).into_iter().map(still).collect()
}

fn handheld(stage: &Stage, config: &DemoConfig) -> Vec<Camera> {
    let target = TABLE_CENTRE + stage.props[TARGET].centre;
    let mut rng = Rng::new(config.seed, 0x0_b17);
    let count = config.views.max(1);
    if config.kind == SceneKind::OneSide {
        return (0..count)
            .map(|i| from_one_side(target, i, config, &mut rng))
            .collect();
    }
    (0..count)
        .map(|i| {
            let turn = (i as f64 + rng.range(-0.22, 0.22)) / count as f64 * core::f64::consts::TAU;
            // Golden-ratio steps visit all elevations evenly without a pattern.
            let golden = (i as f64 + 0.35) * 0.618_033_988_749_895;
            let elevation = (25.5 + 24.0 * (golden - golden.floor())).to_radians();
            let distance = rng.range(0.575, 0.655);
            let eye = target + towards(elevation, turn, distance);
            let mut shake = |by: f64| rng.range(-by, by);
            let aim = target + DVec3::new(shake(0.022), shake(0.022), shake(0.015) - 0.008);
            let roll = shake(0.045);
            let focal = FOCAL_PER_WIDTH * f64::from(config.width);
            Camera::looking_at((config.width, config.height), focal, eye, aim, roll)
        })
        .collect()
}

/// What is so far away, by its elevation and its direction about z, radians.
fn towards(elevation: f64, azimuth: f64, distance: f64) -> DVec3 {
    let level = distance * libm::cos(elevation);
    DVec3::new(
        level * libm::cos(azimuth),
        level * libm::sin(azimuth),
        distance * libm::sin(elevation),
    )
}

/// Three stands, one above the other; before each the turntable goes round once.
fn before_a_turntable(stage: &Stage, config: &DemoConfig) -> Vec<Shot> {
    /// Elevation and direction from the target in the room, degrees.
    const STANDS: [(f64, f64); 3] = [(15.0, 146.0), (29.0, 138.0), (46.0, 151.0)];
    let target = TABLE_CENTRE + stage.props[TARGET].centre;
    let axis = TABLE_CENTRE + stage.axis();
    let mut rng = Rng::new(config.seed, 0x7a_b1e);
    let count = config.views.max(1);
    let mut shots = Vec::with_capacity(count);
    for (stand, (elevation, azimuth)) in STANDS.into_iter().enumerate() {
        let distance = rng.range(0.60, 0.66);
        let eye = target + towards(elevation.to_radians(), azimuth.to_radians(), distance);
        let mut shake = |by: f64| rng.range(-by, by);
        let aim = target + DVec3::new(shake(0.015), shake(0.015), shake(0.01) - 0.008);
        let focal = FOCAL_PER_WIDTH * f64::from(config.width);
        let size = (config.width, config.height);
        let camera = Camera::looking_at(size, focal, eye, aim, shake(0.01));
        let here = (stand + 1) * count / STANDS.len() - shots.len();
        for i in 0..here {
            let part = i as f64 + stand as f64 / STANDS.len() as f64 + rng.range(-0.1, 0.1);
            let turn = part / here as f64 * core::f64::consts::TAU;
            shots.push(Shot {
                camera: camera.before_turned(axis, turn),
                in_room: camera,
                turn,
            });
        }
    }
    shots
}

/// One of the cameras on a patch 20 cm wide and 16 cm high, 75 cm before the target.
fn from_one_side(target: DVec3, i: usize, config: &DemoConfig, rng: &mut Rng) -> Camera {
    let golden = (i as f64 + 0.5) * 0.618_033_988_749_895;
    let right = (i as f64 + 0.5) / config.views.max(1) as f64 - 0.5;
    let up = golden - golden.floor() - 0.5;
    let away = -0.75 + rng.range(-0.02, 0.02);
    let eye = target + DVec3::new(0.20 * right, away, 0.17 + 0.16 * up);
    let mut shake = |by: f64| rng.range(-by, by);
    let aim = target + DVec3::new(shake(0.03), shake(0.02), shake(0.02) + 0.005);
    let roll = shake(0.03);
    let focal = FOCAL_PER_WIDTH * f64::from(config.width);
    Camera::looking_at((config.width, config.height), focal, eye, aim, roll)
}
