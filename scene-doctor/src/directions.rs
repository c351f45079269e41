//! From where the object is seen.

use crate::finding::{Finding, median};
use crate::scene::Exam;
use glam::DVec3;
use serde::Serialize;

/// All around counts from this much of the circle on, in degrees.
const ORBIT: f64 = 270.0;
/// Cameras of a capture that faces one way are within this angle of their mean direction, in degrees,
/// but for a tenth of them.
const ONE_WAY: f64 = 40.0;
/// A larger gap in an orbit is worth another few photos, in degrees.
const GAP: f64 = 60.0;
/// Directions this near the vertical have no azimuth worth the name, in degrees.
const STEEP: f64 = 75.0;
/// Neighbouring photos farther apart show too different sides, in degrees.
const FAR_APART: f64 = 30.0;

/// How a scene was captured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Capture {
    /// The cameras go around the object.
    Orbit,
    /// They look from one side.
    ForwardFacing,
    /// Something between.
    Mixed,
}

impl std::fmt::Display for Capture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Capture::Orbit => "an orbit",
            Capture::ForwardFacing => "forward-facing",
            Capture::Mixed => "part of an orbit",
        })
    }
}

/// Directions from which a point is seen; all angles in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coverage {
    /// How it was captured.
    pub(crate) capture: Capture,
    /// Of the circle around the vertical, what is not the largest gap.
    pub(crate) azimuth: f64,
    /// Largest turn around the vertical between two neighbouring cameras.
    pub(crate) gap: f64,
    /// Lowest and highest camera over the horizon.
    pub(crate) elevation: [f64; 2],
    /// Nine tenths of the cameras are within this angle of their mean direction.
    pub(crate) cone: f64,
    /// Median angle between a camera and the nearest other one.
    pub(crate) step: f64,
}

impl Coverage {
    /// Of the directions from a point to cameras. `None` without any.
    pub(crate) fn of(directions: &[DVec3], up: DVec3) -> Option<Self> {
        let units: Vec<DVec3> = directions
            .iter()
            .filter_map(|d| d.try_normalize())
            .collect();
        if units.is_empty() {
            return None;
        }
        let (east, north) = up.any_orthonormal_pair();
        let elevations: Vec<f64> = units
            .iter()
            .map(|d| d.dot(up).clamp(-1.0, 1.0).asin().to_degrees())
            .collect();
        let mut azimuths: Vec<f64> = units
            .iter()
            .zip(&elevations)
            .filter(|(_, elevation)| elevation.abs() < STEEP)
            .map(|(d, _)| d.dot(north).atan2(d.dot(east)).to_degrees())
            .collect();
        azimuths.sort_by(f64::total_cmp);
        let around = azimuths
            .first()
            .zip(azimuths.last())
            .map_or(360.0, |(a, b)| 360.0 + a - b);
        let gap = azimuths
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .fold(around, f64::max);
        let mean = units.iter().sum::<DVec3>().try_normalize().unwrap_or(up);
        let mut off: Vec<f64> = units
            .iter()
            .map(|d| d.angle_between(mean).to_degrees())
            .collect();
        off.sort_by(f64::total_cmp);
        let cone = off[(9 * (off.len() - 1)) / 10];
        let azimuth = 360.0 - gap;
        let capture = if azimuth >= ORBIT {
            Capture::Orbit
        } else if cone <= ONE_WAY {
            Capture::ForwardFacing
        } else {
            Capture::Mixed
        };
        let low = elevations.iter().copied().fold(90.0, f64::min);
        let high = elevations.iter().copied().fold(-90.0, f64::max);
        Some(Self {
            capture,
            azimuth,
            gap,
            elevation: [low, high],
            cone,
            step: step(&units),
        })
    }
}

/// Median angle between a direction and the nearest other one, in degrees.
fn step(units: &[DVec3]) -> f64 {
    let nearest = (0..units.len()).filter_map(|i| {
        (0..units.len())
            .filter(|j| *j != i)
            .map(|j| units[i].angle_between(units[j]).to_degrees())
            .min_by(f64::total_cmp)
    });
    median(nearest).unwrap_or(0.0)
}

/// How well the cameras go around the object. `None` where it is not known where that is.
pub(crate) fn coverage(exam: &Exam) -> Option<Finding> {
    let (centre, _) = exam.object()?;
    let seeing: Vec<DVec3> = exam
        .views
        .iter()
        .filter(|view| view.pixel_of(centre).is_some())
        .map(|view| view.centre() - centre)
        .collect();
    let all = exam.views.len();
    let Some(found) = Coverage::of(&seeing, exam.up()) else {
        return Some(
            Finding::pass("coverage", "no photo shows the middle of the object's box")
                .number("photos_that_see_it", 0)
                .fail("check that poses and photos belong together, and where the object is (--masks, --click, --box)"),
        );
    };
    let [low, high] = found.elevation;
    let mut says = format!(
        "{}: seen from {:.0}° of 360° around and from {low:.0}° to {high:.0}° above the horizon, a \
         photo every {:.0}°",
        found.capture, found.azimuth, found.step
    );
    match found.capture {
        Capture::Orbit => says.push_str(&format!("; largest gap {:.0}°", found.gap)),
        Capture::Mixed | Capture::ForwardFacing => {
            says.push_str("; the side that no photo shows is guessed in the mesh");
        }
    }
    if seeing.len() < all {
        says.push_str(&format!(
            "; {} of {all} photos do not show its middle",
            all - seeing.len()
        ));
    }
    let finding = Finding::pass("coverage", says)
        .number(
            "capture",
            serde_json::to_value(found.capture).unwrap_or_default(),
        )
        .number("azimuth_deg", rounded(found.azimuth))
        .number("largest_gap_deg", rounded(found.gap))
        .number("lowest_deg", rounded(low))
        .number("highest_deg", rounded(high))
        .number("cone_deg", rounded(found.cone))
        .number("step_deg", rounded(found.step))
        .number("photos_that_see_it", seeing.len());
    Some(if 2 * seeing.len() < all {
        finding.warn(
            "if the box is in the wrong place, say where the object is (--masks, --click, --box)",
        )
    } else if found.step > FAR_APART {
        finding.warn("neighbouring photos have little in common; take one every 10° to 15°")
    } else if found.capture == Capture::Orbit && found.gap > GAP {
        finding.warn(
            "take a few more photos in the gap, or expect soft edges and a guessed surface there",
        )
    } else {
        finding
    })
}

/// To a hundredth, which is what is measured.
pub(crate) fn rounded(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(degrees: impl Iterator<Item = i32>) -> Vec<DVec3> {
        degrees
            .map(|a| {
                let a = f64::from(a).to_radians();
                DVec3::new(3.0 * a.cos(), 3.0 * a.sin(), 1.0)
            })
            .collect()
    }

    #[test]
    fn captures_are_told_apart() {
        let of = |directions: &[DVec3]| Coverage::of(directions, DVec3::Z);
        let orbit = of(&ring((0..360).step_by(10)));
        assert_eq!(orbit.map(|c| c.capture), Some(Capture::Orbit));
        assert!(orbit.is_some_and(|c| (c.gap - 10.0).abs() < 1e-9 && (c.step - 9.49).abs() < 0.1));
        assert!(orbit.is_some_and(|c| (c.elevation[0] - 18.43).abs() < 0.1));
        let half = of(&ring((0..=180).step_by(10)));
        assert_eq!(half.map(|c| c.capture), Some(Capture::Mixed));
        assert!(half.is_some_and(|c| (c.azimuth - 180.0).abs() < 1e-9));
        let front = of(&ring((-20..=20).step_by(5)));
        assert_eq!(front.map(|c| c.capture), Some(Capture::ForwardFacing));
        // Across the seam of the circle.
        let seam = of(&ring((150..=210).step_by(10)));
        assert!(seam.is_some_and(|c| (c.azimuth - 60.0).abs() < 1e-9));
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[DVec3::ZERO]), None);
        assert!(of(&[DVec3::Z]).is_some_and(|c| c.gap == 360.0));
    }
}
