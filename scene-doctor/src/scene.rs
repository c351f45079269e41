//! What is examined: everything the checks look at, in one place.

use crate::photo::PhotoMeasures;
use glam::{DVec2, DVec3};
use image::GrayImage;
use io_colmap::{Camera, Pose, SparsePoint};
use rayon::prelude::*;
use std::fmt;

/// A mask of the object, however it is kept.
pub trait ObjectMask: fmt::Debug + Sync {
    /// Whether a pixel of the photo is the object's.
    fn is_object(&self, x: u32, y: u32) -> bool;
}

/// White is the object.
impl ObjectMask for GrayImage {
    fn is_object(&self, x: u32, y: u32) -> bool {
        self.get_pixel_checked(x, y).is_some_and(|p| p.0[0] >= 128)
    }
}

/// One photo with its camera.
#[derive(Debug, Clone, Copy)]
pub struct ExamView<'a> {
    /// As the model calls it.
    pub name: &'a str,
    /// [`io_colmap::View::id`], which the tracks of sparse points refer to.
    pub id: u32,
    /// At the photo's size.
    pub camera: &'a Camera,
    /// In the scene's frame.
    pub camera_from_world: Pose,
    /// 8-bit sRGB, row by row, of the camera's size.
    pub photo: &'a [u8],
    /// Of the camera's size, where there is one.
    pub mask: Option<&'a dyn ObjectMask>,
}

impl ExamView<'_> {
    /// The camera's centre in the scene's frame.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.camera_from_world.centre()
    }

    /// Width and height of the photo in pixels.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.camera.width, self.camera.height)
    }

    /// Where a point of the scene is in the photo, in pixels; `None` outside it.
    #[must_use]
    pub fn pixel_of(&self, world: DVec3) -> Option<DVec2> {
        let point = self.camera_from_world.transform_point(world);
        // Behind them, panoramas and wide lenses see too.
        let pixel = self.camera.project(point)?;
        let size = DVec2::new(self.camera.width.into(), self.camera.height.into());
        (pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()).then_some(pixel)
    }
}

/// Where the object is.
#[derive(Debug, Clone, PartialEq)]
pub enum Subject {
    /// In a cube along the axes of the scene's frame.
    Found {
        /// Its middle.
        centre: DVec3,
        /// Half its side, in the scene's unit.
        half_side: f64,
        /// Who says so, as the end of "the object is": "where the cameras look".
        by: String,
    },
    /// Nothing tells.
    Unknown {
        /// Why, and what to do: a sentence without a full stop.
        why: String,
    },
}

/// The plane that the object stands on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Unit normal, towards the cameras.
    pub normal: DVec3,
    /// One of its points.
    pub point: DVec3,
}

impl Ground {
    /// Signed height above the plane, in the scene's unit.
    #[must_use]
    pub fn height(&self, world: DVec3) -> f64 {
        self.normal.dot(world - self.point)
    }
}

/// A scene, opened, with its measures taken.
#[derive(Debug)]
pub struct Exam<'a> {
    /// In the model's order.
    pub views: Vec<ExamView<'a>>,
    /// Measures of each view's photo.
    pub(crate) measures: Vec<PhotoMeasures>,
    /// The model's sparse points.
    pub points: &'a [SparsePoint],
    /// Where the object is.
    pub subject: Subject,
    /// What it stands on, if that was found.
    pub ground: Option<Ground>,
}

impl<'a> Exam<'a> {
    /// Takes the measures.
    ///
    /// # Panics
    /// When a photo has not the size of its camera.
    #[must_use]
    pub fn new(
        views: Vec<ExamView<'a>>,
        points: &'a [SparsePoint],
        subject: Subject,
        ground: Option<Ground>,
    ) -> Self {
        let measures = views
            .par_iter()
            .map(|view| PhotoMeasures::of(view.photo, view.camera.width, view.camera.height))
            .collect();
        Self {
            views,
            measures,
            points,
            subject,
            ground,
        }
    }

    /// Middle and half side of the object's box.
    #[must_use]
    pub fn object(&self) -> Option<(DVec3, f64)> {
        match self.subject {
            Subject::Found {
                centre, half_side, ..
            } => Some((centre, half_side)),
            Subject::Unknown { .. } => None,
        }
    }

    /// Unit vector that is up in the scene: the ground's normal, else up in most photos.
    #[must_use]
    pub fn up(&self) -> DVec3 {
        if let Some(ground) = self.ground {
            return ground.normal;
        }
        let sum: DVec3 = self
            .views
            .iter()
            .map(|view| view.camera_from_world.inverse().transform_vector(-DVec3::Y))
            .sum();
        sum.try_normalize().unwrap_or(DVec3::Z)
    }

    /// The numbers of the views that look most like view `i`, nearest first: by where they look, and
    /// where from.
    pub(crate) fn neighbours(&self, i: usize, count: usize) -> Vec<usize> {
        let spread = self.camera_spread().max(f64::MIN_POSITIVE);
        let own = &self.views[i];
        let forward = |view: &ExamView| view.camera_from_world.inverse().transform_vector(DVec3::Z);
        let mut others: Vec<(f64, usize)> = (0..self.views.len())
            .filter(|j| *j != i)
            .map(|j| {
                let other = &self.views[j];
                let turn = forward(own).angle_between(forward(other));
                (turn + own.centre().distance(other.centre()) / spread, j)
            })
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        others.into_iter().take(count).map(|(_, j)| j).collect()
    }

    /// Largest distance of a camera from their mean.
    pub(crate) fn camera_spread(&self) -> f64 {
        let mean =
            self.views.iter().map(ExamView::centre).sum::<DVec3>() / self.views.len().max(1) as f64;
        self.views
            .iter()
            .map(|view| view.centre().distance(mean))
            .fold(0.0, f64::max)
    }

    /// Whether a point lies in the object's box.
    pub(crate) fn in_box(&self, world: DVec3) -> bool {
        self.object()
            .is_some_and(|(centre, half)| (world - centre).abs().max_element() <= half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_colmap::CameraModel;

    #[test]
    fn lenses_that_see_behind_them_see_there() {
        let sees = |model, params: &[f64], world| {
            let camera = Camera {
                id: 1,
                model,
                width: 200,
                height: 100,
                params: params.to_vec(),
            };
            let view = ExamView {
                name: "a.jpg",
                id: 1,
                camera: &camera,
                camera_from_world: Pose::IDENTITY,
                photo: &[],
                mask: None,
            };
            view.pixel_of(world).is_some()
        };
        let (before, behind) = (DVec3::new(0.1, 0.0, 1.0), DVec3::new(1.0, 0.0, -0.2));
        let panorama = (CameraModel::Equirectangular, [200.0, 100.0]);
        // 100 pixels from its middle, its picture ends at two radians.
        let fisheye = (CameraModel::SimpleRadialFisheye, [50.0, 100.0, 50.0, 0.0]);
        let pinhole = (CameraModel::SimplePinhole, [50.0, 100.0, 50.0]);
        for point in [before, behind] {
            assert!(sees(panorama.0, &panorama.1, point), "{point}");
            assert!(sees(fisheye.0, &fisheye.1, point), "{point}");
        }
        assert!(sees(pinhole.0, &pinhole.1, before) && !sees(pinhole.0, &pinhole.1, behind));
    }
}
