//! What all cameras have in common when they move is no news: the scene could have moved instead.

use glam::{DQuat, DVec3};
use io_colmap::Pose;

/// Moves `poses` together, about `centre`, so that on average they are where `before` has them; for small motions.
///
/// Whatever else is known in the scene's frame, other cameras in it for one, then stays right.
pub(super) fn keep_in_place(poses: &mut [Pose], before: &[Pose], centre: DVec3) {
    let count = poses.len().max(1) as f64;
    let (mut turn, mut shift) = (DVec3::ZERO, DVec3::ZERO);
    for (pose, before) in poses.iter().zip(before) {
        // Where the camera's motion would have things move, were it the scene that moves.
        let seen = before.transform_point(centre);
        shift += (pose.inverse().transform_point(seen) - centre) / count;
        let rotation = pose.rotation.conjugate() * before.rotation;
        turn += shortest(rotation).to_scaled_axis() / count;
    }
    let rotation = DQuat::from_scaled_axis(turn);
    for pose in poses {
        // After the common motion about the centre.
        let moved = pose.rotation * (centre + shift - rotation * centre);
        *pose = Pose {
            rotation: (pose.rotation * rotation).normalize(),
            translation: moved + pose.translation,
        };
    }
}

/// The same rotation by less than half a turn.
fn shortest(rotation: DQuat) -> DQuat {
    if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras around a centre that is not the origin.
    fn ring(centre: DVec3) -> Vec<Pose> {
        let pose = |i: i32| {
            let rotation = DQuat::from_rotation_y(f64::from(i)) * DQuat::from_rotation_x(0.4);
            Pose {
                rotation,
                translation: DVec3::new(0.0, 0.0, 4.0) - rotation * centre,
            }
        };
        (0..6).map(pose).collect()
    }

    fn farthest(a: &[Pose], b: &[Pose]) -> f64 {
        let places = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let between = |(a, b): (&Pose, &Pose)| {
            let apart = places.map(|p| a.transform_point(p).distance(b.transform_point(p)));
            apart.into_iter().fold(0.0, f64::max)
        };
        a.iter().zip(b).map(between).fold(0.0, f64::max)
    }

    #[test]
    fn what_moves_together_moves_back() {
        let centre = DVec3::new(3.0, -1.0, 2.0);
        let before = ring(centre);
        let common = Pose {
            rotation: DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.03)),
            translation: DVec3::new(0.05, 0.02, -0.04),
        };
        let mut poses: Vec<Pose> = before
            .iter()
            .map(|pose| Pose {
                rotation: pose.rotation * common.rotation,
                translation: pose.transform_point(common.translation),
            })
            .collect();
        assert!(farthest(&poses, &before) > 0.05);
        keep_in_place(&mut poses, &before, centre);
        assert!(farthest(&poses, &before) < 1e-9);
    }

    #[test]
    fn what_one_moves_by_itself_stays() {
        let before = ring(DVec3::ZERO);
        let mut poses = before.clone();
        let turn = DQuat::from_rotation_z(0.06);
        poses[2].rotation = turn * poses[2].rotation;
        keep_in_place(&mut poses, &before, DVec3::ZERO);
        let angle = |i: usize| poses[i].rotation.angle_between(before[i].rotation);
        // A sixth of it is everybody's.
        assert!((angle(2) - 0.05).abs() < 1e-6, "{}", angle(2));
        assert!((angle(0) - 0.01).abs() < 1e-6, "{}", angle(0));
    }
}
