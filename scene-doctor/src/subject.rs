//! The object's place, and what it stands on.

use crate::directions::rounded;
use crate::finding::{Finding, median, percent};
use crate::scene::{Exam, Subject};
use glam::DVec3;

/// Points this near the ground lie on it, over half the box's side.
const ON_GROUND: f64 = 0.02;

/// Where the object is, and what of it was triangulated.
pub(crate) fn object(exam: &Exam) -> Finding {
    let (centre, half_side, by) = match &exam.subject {
        Subject::Found {
            centre,
            half_side,
            by,
        } => (*centre, *half_side, by),
        Subject::Unknown { why } => {
            let (says, remedy) = why.split_once("; ").unwrap_or((
                why,
                "show where it is with rough masks (--masks), --click VIEW:X,Y or --box",
            ));
            return Finding::pass("object", says).fail(remedy);
        }
    };
    let inside = exam
        .points
        .iter()
        .filter(|point| exam.in_box(point.position))
        .count();
    let cameras = exam
        .views
        .iter()
        .filter(|view| exam.in_box(view.centre()))
        .count();
    // Of the photo's height, at the distance of its middle.
    let size = median(exam.views.iter().map(|view| {
        let (_, focal) = view.camera.focal();
        2.0 * half_side * focal
            / view.centre().distance(centre).max(f64::MIN_POSITIVE)
            / f64::from(view.camera.height)
    }))
    .unwrap_or(f64::NAN);
    let mut says = format!(
        "{by}: in a box around ({:.3}, {:.3}, {:.3}) with sides of {:.3} in the scene's unit, usually \
         {} of a photo's height",
        centre.x,
        centre.y,
        centre.z,
        2.0 * half_side,
        percent(size)
    );
    says.push_str(&match exam.points.len() {
        0 => "; there are no sparse points".to_owned(),
        all => format!("; {inside} of {all} sparse points are in it"),
    });
    if cameras > 0 {
        says.push_str(&format!("; {cameras} cameras are in it, too"));
    }
    let finding = Finding::pass("object", says)
        .number("centre", centre.to_array().to_vec())
        .number("side", 2.0 * half_side)
        .number("share_of_height", rounded(size))
        .number("sparse_points_inside", inside)
        .number("cameras_inside", cameras);
    if cameras > 0 {
        finding.warn(if exam.views.iter().filter(|view| view.mask.is_some()).count() > 1 {
            "masks from much the same side do not tell how deep the object is, and a box as deep as \
             this makes training slow and the surface vague; take photos from farther around, or \
             leave masks out (--masks none) and give --box"
        } else {
            "nobody photographs from within an object; say where it is with --click or --box"
        })
    } else {
        finding
    }
}

/// The plane the object stands on. `None` where there are no points to find one among.
pub(crate) fn ground(exam: &Exam) -> Option<Finding> {
    let (centre, half_side) = exam.object()?;
    if exam.points.is_empty() {
        return None;
    }
    let Some(ground) = exam.ground else {
        return Some(
            Finding::pass(
                "ground",
                "no plane that it stands on was found among the sparse points; only a search without \
                 masks needs one",
            )
            .number("found", false),
        );
    };
    let on = exam
        .points
        .iter()
        .filter(|point| ground.height(point.position).abs() < ON_GROUND * half_side)
        .count();
    let height = ground.height(centre) / (2.0 * half_side);
    let side = if height < 0.0 { "below" } else { "above" };
    Some(
        Finding::pass(
            "ground",
            format!(
                "it stands on a plane with {on} sparse points on it; the middle of the box is {:.2} of \
                 its sides {side} it",
                height.abs()
            ),
        )
        .number("found", true)
        .number("points_on_it", on)
        .number("normal", ground.normal.to_array().to_vec())
        .number("middle_above_in_sides", rounded(height)),
    )
}

/// The corners of the object's box.
pub(crate) fn corners(centre: DVec3, half_side: f64) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let sign = |bit: usize| {
            if i >> bit & 1 == 1 {
                half_side
            } else {
                -half_side
            }
        };
        centre + DVec3::new(sign(0), sign(1), sign(2))
    })
}
