//! How far the cameras moved for what they look at: without that, nothing tells depth.

use crate::directions::rounded;
use crate::finding::{Finding, median};
use crate::scene::{Exam, ExamView};
use glam::DVec3;
use std::collections::HashMap;

/// Below this angle there is no depth, only noise; in degrees. Structure from motion itself drops
/// points below 1.5.
const NONE: f64 = 0.5;
/// Below this one depth is coarse; in degrees.
const SMALL: f64 = 5.0;
/// Fewer points than this say less than the box.
const LEAST_POINTS: usize = 20;
/// More points than this say nothing new.
const MOST_POINTS: usize = 5000;

/// The angle at the object between the rays that see it from farthest apart.
pub(crate) fn parallax(exam: &Exam) -> Finding {
    let views: HashMap<u32, &ExamView> = exam.views.iter().map(|view| (view.id, view)).collect();
    let angles = |inside: bool| -> Vec<f64> {
        let chosen: Vec<_> = exam
            .points
            .iter()
            .filter(|point| !inside || exam.in_box(point.position))
            .collect();
        let stride = chosen.len().div_ceil(MOST_POINTS).max(1);
        chosen
            .iter()
            .step_by(stride)
            .filter_map(|point| {
                let seen_from = point.views.iter().filter_map(|id| views.get(id));
                widest(point.position, seen_from.map(|view| view.centre()))
            })
            .collect()
    };
    let (measured, of) = match (angles(true), angles(false)) {
        (on_object, _) if on_object.len() >= LEAST_POINTS => {
            let of = format!(
                "median of {} sparse points on it or near it",
                on_object.len()
            );
            (median(on_object), of)
        }
        (_, all) if exam.object().is_none() && all.len() >= LEAST_POINTS => {
            let of = format!("median of {} sparse points", all.len());
            (median(all), of)
        }
        (_, all) => {
            // Without points on the object: its middle, unless all points agree that the cameras
            // stayed where they were, when there is no telling where it is.
            let still = median(all).filter(|angle| *angle < NONE);
            let seeing = exam.object().and_then(|(centre, _)| {
                let seeing = exam
                    .views
                    .iter()
                    .filter(|view| view.pixel_of(centre).is_some());
                widest(centre, seeing.map(ExamView::centre))
            });
            match still {
                Some(_) => (still, "median of the sparse points".to_owned()),
                None => (seeing, "measured at the middle of its box".to_owned()),
            }
        }
    };
    let spread = exam.camera_spread();
    let far = exam.views.iter().map(|view| view.centre().length());
    let far = far.fold(0.0, f64::max);
    // Rounding alone moves cameras that much.
    let measured = if spread <= 1e-9 * far {
        Some(0.0)
    } else {
        measured
    };
    let Some(angle) = measured else {
        return Finding::pass("parallax", unmeasured(exam)).number("widest_deg", f64::NAN);
    };
    let finding = Finding::pass(
        "parallax",
        format!("rays to the same place meet at up to {angle:.1}° ({of})"),
    )
    .number("widest_deg", rounded(angle));
    if angle < NONE {
        Finding {
            says: format!(
                "the cameras turned, but hardly moved: rays to the same place meet at {angle:.2}°, \
                 from which no depth can be told"
            ),
            ..finding
        }
        .fail("walk around the object while taking photos; turning on the spot is not enough")
    } else if angle < SMALL {
        finding.warn("depth will be coarse; take photos from farther apart, or go nearer")
    } else {
        finding
    }
}

/// Why there is no angle.
fn unmeasured(exam: &Exam) -> String {
    let (place, besides) = match exam.object() {
        Some(_) => (
            " on the object or near it",
            "fewer than two photos show the middle of its box",
        ),
        None => ("", "it is not known where the object is"),
    };
    let few = match exam.points.len() {
        0 => "there are no sparse points".to_owned(),
        _ => format!("there are fewer than {LEAST_POINTS} sparse points{place}"),
    };
    format!("not measured: {few}, and {besides}")
}

/// The largest angle at `point` between two of the centres, in degrees; `None` for fewer than two.
fn widest(point: DVec3, centres: impl Iterator<Item = DVec3>) -> Option<f64> {
    let rays: Vec<DVec3> = centres
        .filter_map(|c| (c - point).try_normalize())
        .collect();
    // Of hundreds of rays, those farthest from the first and from that one: no more than a factor of
    // two below the largest, and exact for rays in one plane.
    let farthest = |from: DVec3| {
        rays.iter()
            .map(|ray| (ray.angle_between(from), *ray))
            .max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let first = *rays.first()?;
    let (_, end) = farthest(first).filter(|_| rays.len() > 1)?;
    let (angle, _) = farthest(end)?;
    Some(angle.to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Subject;
    use io_colmap::{Camera, CameraModel, Pose, SparsePoint};

    #[test]
    fn what_was_not_measured_is_said_as_it_is() {
        let camera = Camera {
            id: 1,
            model: CameraModel::SimplePinhole,
            width: 8,
            height: 8,
            params: vec![8.0, 4.0, 4.0],
        };
        let photo = [0; 3 * 8 * 8];
        let said = |subject: Subject, points: &[SparsePoint]| {
            let views = [0.0, 1.0].map(|x| ExamView {
                name: "a.jpg",
                id: 1,
                camera: &camera,
                camera_from_world: Pose {
                    translation: DVec3::X * x,
                    ..Pose::IDENTITY
                },
                photo: &photo,
                mask: None,
            });
            parallax(&Exam::new(views.to_vec(), points, subject, None)).says
        };
        // Behind both cameras.
        let found = Subject::Found {
            centre: -DVec3::Z,
            half_side: 0.5,
            by: "where it was said to be".to_owned(),
        };
        let unknown = Subject::Unknown {
            why: "nothing tells".to_owned(),
        };
        let point = SparsePoint {
            id: 1,
            position: DVec3::ZERO,
            colour: [0; 3],
            error: 0.0,
            views: Vec::new(),
        };
        assert_eq!(
            said(found.clone(), &[]),
            "not measured: there are no sparse points, and fewer than two photos show the middle of its box"
        );
        assert_eq!(
            said(found, &[point]),
            "not measured: there are fewer than 20 sparse points on the object or near it, and fewer than two photos \
             show the middle of its box"
        );
        assert_eq!(
            said(unknown, &[]),
            "not measured: there are no sparse points, and it is not known where the object is"
        );
    }

    #[test]
    fn the_widest_pair_counts() {
        let at = |degrees: f64| {
            let a = degrees.to_radians();
            DVec3::new(a.cos(), a.sin(), 0.0) * 4.0
        };
        let angle = |degrees: &[f64]| widest(DVec3::ZERO, degrees.iter().map(|d| at(*d)));
        assert!(angle(&[10.0, -20.0, 3.0, 25.0]).is_some_and(|a| (a - 45.0).abs() < 1e-9));
        assert!(angle(&[10.0, 10.0]).is_some_and(|a| a < 1e-6));
        assert_eq!(angle(&[10.0]), None);
        assert_eq!(widest(DVec3::ZERO, [DVec3::ZERO; 2].into_iter()), None);
    }
}
