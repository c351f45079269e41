//! The region of interest: a cube in which the object must be.

use glam::{DVec2, DVec3, Vec3};
use io_colmap::SparsePoint;

use super::sweep;
use crate::median::median;
use crate::prepare::error::PrepareError;
use crate::prepare::locate::{box_from_cameras, closest_to_ray};
use crate::prepare::{Frame, TrainView};

/// A region over the one in which the object was cut off.
pub(super) const ENLARGED: f64 = 1.5;
/// A region over the one in which a tip of the object was cut off.
pub(super) const ENLARGED_FOR_TIP: f64 = 1.25;
/// The region over the box that a run without masks would have: what the object stands on has to go
/// on around it to be known for what it is.
const SURROUNDINGS: f64 = 1.7;
/// Half the region's side over the radius of what one mask shows.
const MASK_RADII: f64 = 2.5;
/// Half the region's side around a click, over the distance times half the picture's angle: what is
/// clicked on may fill the picture, and lies behind what the pixel shows.
const CLICK_SHARE: f64 = 1.0;
/// The region that cameras look at anyway, beyond so many times that around a click, is too coarse for
/// what was clicked on.
const COARSE: f64 = 2.5;
/// Sparse points this near a pixel, as a share of the picture's smaller side, tell its distance.
const NEAR_PIXEL: f64 = 0.04;

/// Where the cameras look. Where their axes do not meet, as in a capture that faces one way: around
/// the sparse points in the middle of the pictures.
pub(super) fn of_cameras(
    views: &[TrainView],
    points: &[SparsePoint],
) -> Result<Frame, PrepareError> {
    match box_from_cameras(views) {
        Ok(frame) => Ok(Frame {
            half_side: SURROUNDINGS * frame.half_side,
            ..frame
        }),
        Err(error) => central_points(views, &positions(views, points, None)?).ok_or(error),
    }
}

/// Where the sparse points are; for a scene without any, places that its photos agree on, of which those `near` a pixel
/// of a view are enough, within a radius.
fn positions(
    views: &[TrainView],
    points: &[SparsePoint],
    near: Option<(usize, DVec2, f64)>,
) -> Result<Vec<DVec3>, PrepareError> {
    if points.is_empty() {
        return sweep::places(views, near);
    }
    Ok(points.iter().map(|point| point.position).collect())
}

/// Around the nearer half of the points that most views show in their middle.
fn central_points(views: &[TrainView], points: &[DVec3]) -> Option<Frame> {
    let mut central: Vec<(f64, DVec3)> = points
        .iter()
        .filter_map(|&point| {
            let (mut seen, mut middle, mut depth) = (0, 0, 0.0);
            for view in views {
                if let Some((pixel, z)) = view.project(point) {
                    let off =
                        pixel.as_dvec2() / DVec2::new(view.width().into(), view.height().into());
                    seen += 1;
                    middle += u32::from((off - 0.5).abs().max_element() < 0.25);
                    depth += f64::from(z);
                }
            }
            (2 * seen > views.len() && 2 * middle > seen as u32)
                .then(|| (depth / seen as f64, point))
        })
        .collect();
    if central.len() < 8 {
        return None;
    }
    central.sort_by(|a, b| a.0.total_cmp(&b.0));
    central.truncate(central.len().div_ceil(2));
    let middle = central[central.len() / 2].0;
    let centre = central.iter().map(|(_, at)| *at).sum::<DVec3>() / central.len() as f64;
    Some(Frame {
        centre,
        half_side: 0.5 * middle * angle(&views[0]),
    })
}

/// What the cameras look at anyway, where that holds what the pixel shows: the object is whole in it. Else
/// around what the pixel shows.
pub(super) fn around_click(
    views: &[TrainView],
    points: &[SparsePoint],
    view: usize,
    pixel: DVec2,
) -> Result<Frame, PrepareError> {
    let near = at_pixel(views, points, view, pixel, None)?;
    Ok(match of_cameras(views, points) {
        Ok(whole)
            if whole.half_side <= COARSE * near.half_side
                && whole.normalised_from_world(near.centre).abs().max_element() < 1.0 =>
        {
            whole
        }
        _ => near,
    })
}

/// Around what a pixel shows; `radius` is that of the object there, in pixels, if it is known.
pub(super) fn at_pixel(
    views: &[TrainView],
    points: &[SparsePoint],
    view: usize,
    pixel: DVec2,
    radius: Option<f64>,
) -> Result<Frame, PrepareError> {
    let photo = &views[view];
    let side = f64::from(photo.width().min(photo.height()));
    let near = radius.unwrap_or(NEAR_PIXEL * side);
    let mut depths: Vec<f64> = positions(views, points, Some((view, pixel, near)))?
        .into_iter()
        .filter_map(|point| {
            let (at, z) = photo.project(point)?;
            (at.as_dvec2().distance(pixel) <= near).then_some(f64::from(z))
        })
        .collect();
    let direction = photo.lens.0.unproject(pixel).ok_or_else(|| {
        PrepareError::Scene(format!(
            "{}: its lens shows nothing at {pixel}; show the object in a photo that has it nearer to the middle",
            photo.name
        ))
    })?;
    let world_from_camera = photo.camera_from_world.inverse();
    // As long as the optical axis advances by one.
    let (origin, along) = (
        photo.camera_from_world.centre(),
        world_from_camera.transform_vector(direction / direction.z.max(1e-6)),
    );
    let depth = match median(&mut depths) {
        Some(depth) => depth,
        // No point there: as far as where the cameras look.
        None => closest_to_ray(views, origin, along)?,
    };
    let (fx, fy) = photo.lens.0.focal();
    let half_side = match radius {
        Some(radius) => MASK_RADII * depth * radius / (fx * fy).sqrt(),
        None => CLICK_SHARE * depth * angle(photo),
    };
    Ok(Frame {
        centre: origin + along * depth,
        half_side,
    })
}

/// A region `growth` times as large for an object that goes on beyond `frame`: `towards` is -1 or 1 for axes along
/// which it does on one side, where all of the growth goes.
pub(super) fn enlarged(frame: &Frame, towards: Vec3, growth: f64) -> Frame {
    Frame {
        centre: frame.centre + (growth - 1.0) * frame.half_side * towards.as_dvec3(),
        half_side: growth * frame.half_side,
    }
}

/// Half the angle of a picture's smaller side, as a tangent.
fn angle(view: &TrainView) -> f64 {
    let (fx, fy) = view.lens.0.focal();
    0.5 * f64::from(view.width().min(view.height())) / (fx * fy).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_region_holds_the_one_before_and_grows_to_where_the_object_goes_on() {
        let frame = Frame {
            centre: DVec3::new(1.0, 2.0, 3.0),
            half_side: 2.0,
        };
        let larger = enlarged(&frame, Vec3::new(1.0, -1.0, 0.0), 1.5);
        let (low, high) = (
            larger.world_from_normalised(Vec3::NEG_ONE),
            larger.world_from_normalised(Vec3::ONE),
        );
        assert_eq!(low, DVec3::new(-1.0, -2.0, 0.0));
        assert_eq!(high, DVec3::new(5.0, 4.0, 6.0));
    }
}
