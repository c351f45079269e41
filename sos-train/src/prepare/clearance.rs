//! A cube around what was found that holds no camera.

use super::frame::Frame;
use glam::DVec3;

/// Margins that are tried in turn, as shares of the one asked for.
const MARGINS: [f64; 3] = [1.0, 0.5, 0.0];
/// Places along each axis that are tried, as shares of the way that there is; nearest first.
const PLACES: [f64; 5] = [0.0, -0.5, 0.5, -1.0, 1.0];

/// The cube around the box from `low` to `high`, with `margin` of its sides on each side.
///
/// An object that is wider than deep leaves the cube room to move: it moves, no farther than it must,
/// off the cameras that it would hold; if that does not do, with less of a margin. Where cameras are
/// inside the box itself, the cube with the fewest of them it is, and the doctor says so.
pub(super) fn clear_of_cameras(low: DVec3, high: DVec3, margin: f64, cameras: &[DVec3]) -> Frame {
    let middle = 0.5 * (low + high);
    let mut best: Option<(usize, Frame)> = None;
    for share in MARGINS {
        let needed = 0.5 * (high - low) * (1.0 + 2.0 * share * margin);
        let half_side = needed.max_element();
        let way = DVec3::splat(half_side) - needed;
        let mut shifts: Vec<DVec3> = PLACES
            .iter()
            .flat_map(|x| PLACES.map(|y| PLACES.map(|z| DVec3::new(*x, y, z) * way)))
            .flatten()
            .collect();
        shifts.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        for shift in shifts {
            let centre = middle + shift;
            let inside = cameras
                .iter()
                .filter(|camera| (**camera - centre).abs().max_element() < half_side)
                .count();
            if best.is_none_or(|(fewest, _)| inside < fewest) {
                best = Some((inside, Frame { centre, half_side }));
            }
            if inside == 0 {
                return Frame { centre, half_side };
            }
        }
    }
    best.map_or(
        Frame {
            centre: middle,
            half_side: 0.5 * (high - low).max_element(),
        },
        |(_, frame)| frame,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOW: DVec3 = DVec3::new(-1.0, -1.0, -0.2);
    const HIGH: DVec3 = DVec3::new(1.0, 1.0, 0.2);

    #[test]
    fn without_cameras_near_by_it_stays_in_the_middle() {
        let frame = clear_of_cameras(LOW, HIGH, 0.15, &[DVec3::new(0.0, 0.0, -4.0)]);
        assert_eq!((frame.centre, frame.half_side), (DVec3::ZERO, 1.3));
    }

    #[test]
    fn it_moves_off_cameras_and_keeps_what_it_holds() {
        let frame = clear_of_cameras(LOW, HIGH, 0.15, &[DVec3::new(0.3, 0.1, -1.1)]);
        assert!(frame.centre.z > 0.2 && frame.half_side == 1.3, "{frame:?}");
        assert!(frame.normalised_from_world(LOW).abs().max_element() < 1.0);
        assert!(frame.normalised_from_world(HIGH).abs().max_element() < 1.0);

        // No way to move along x: the margin gives.
        let frame = clear_of_cameras(LOW, HIGH, 0.15, &[DVec3::new(1.2, 0.0, 0.0)]);
        assert_eq!((frame.centre.x, frame.half_side), (0.0, 1.15));

        // Right inside: nothing helps.
        let frame = clear_of_cameras(LOW, HIGH, 0.15, &[DVec3::ZERO]);
        assert_eq!(frame.half_side, 1.3);
    }
}
