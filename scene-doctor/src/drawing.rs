//! The scene as the page draws it: cameras, sparse points, box and ground.

use crate::finding::{Report, Status};
use crate::scene::Exam;
use crate::subject::corners;
use glam::{DVec2, DVec3};
use serde::Serialize;

/// More points than this slow a page down.
const MOST_POINTS: usize = 12_000;
/// Length of a frustum, over the median distance of cameras from what they look at.
const FRUSTUM: f64 = 0.09;
/// Half the side of the piece of ground that is drawn, over half the box's.
const GROUND: f64 = 2.5;

/// Everything the page's script needs; positions are `[x, y, z]`, single precision, relative to `middle`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drawing {
    /// What the view turns around, in the scene's frame.
    middle: [f64; 3],
    /// Up in the scene.
    up: [f32; 3],
    /// How far the cameras are from the middle, usually.
    radius: f32,
    cameras: Vec<CameraDrawing>,
    /// Positions, one after the other.
    points: Vec<f32>,
    /// Red, green, blue of each point.
    colours: Vec<u8>,
    /// Corners of the object's box.
    corners: Vec<[f32; 3]>,
    /// Corners of a piece of the ground, in turn.
    ground: Vec<[f32; 3]>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct CameraDrawing {
    name: String,
    centre: [f32; 3],
    /// Corners of the picture, in turn from the upper left.
    corners: Vec<[f32; 3]>,
    /// Names of the checks that have something to say about its photo.
    checks: Vec<&'static str>,
}

impl Drawing {
    /// Of an examined scene; cameras remember which findings are about them.
    #[must_use]
    pub fn new(exam: &Exam, report: &Report) -> Self {
        let centres: Vec<DVec3> = exam.views.iter().map(|view| view.centre()).collect();
        let count = centres.len().max(1) as f64;
        let mean = centres.iter().sum::<DVec3>() / count;
        let middle = exam.object().map_or(mean, |(centre, _)| centre);
        let distance = crate::finding::median(centres.iter().map(|c| c.distance(middle)));
        let radius = distance
            .filter(|r| *r > 0.0)
            .or(exam.object().map(|(_, half)| half))
            .unwrap_or(1.0);
        let local = |world: DVec3| (world - middle).as_vec3().to_array();
        let cameras = exam
            .views
            .iter()
            .map(|view| {
                let world_from_camera = view.camera_from_world.inverse();
                let (w, h) = (f64::from(view.camera.width), f64::from(view.camera.height));
                let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]
                    .into_iter()
                    .filter_map(|[x, y]| view.camera.unproject(DVec2::new(x, y)))
                    .map(|ray| world_from_camera.transform_point(ray * FRUSTUM * radius))
                    .map(local)
                    .collect();
                let about = |name: &String| name.as_str() == view.name;
                CameraDrawing {
                    name: view.name.to_owned(),
                    centre: local(view.centre()),
                    corners,
                    checks: report
                        .checks
                        .iter()
                        .filter(|finding| finding.status != Status::Pass)
                        .filter(|finding| finding.photos.iter().any(about))
                        .map(|finding| finding.check)
                        .collect(),
                }
            })
            .collect();
        let stride = exam.points.len().div_ceil(MOST_POINTS).max(1);
        let shown = || exam.points.iter().step_by(stride);
        let ground = match (exam.ground, exam.object()) {
            (Some(ground), Some((centre, half_side))) => {
                let foot = centre - ground.height(centre) * ground.normal;
                let (u, v) = ground.normal.any_orthonormal_pair();
                let reach = GROUND * half_side;
                [u + v, v - u, -u - v, u - v]
                    .map(|corner| local(foot + reach * corner))
                    .to_vec()
            }
            _ => Vec::new(),
        };
        Self {
            middle: middle.to_array(),
            up: exam.up().as_vec3().to_array(),
            radius: radius as f32,
            cameras,
            points: shown().flat_map(|point| local(point.position)).collect(),
            colours: shown().flat_map(|point| point.colour).collect(),
            corners: exam
                .object()
                .map(|(centre, half_side)| corners(centre, half_side).map(local).to_vec())
                .unwrap_or_default(),
            ground,
        }
    }
}
