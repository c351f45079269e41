//! The ground by sparse points, or by places that photos agree on: found by random samples (RANSAC, Fischler and Bolles 1981),
//! and moved to where the fused surface bears it out.

use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::plane::{
    BELOW_GROUND, FACES_UP, LEAST_POINTS, NEAR, Plane, SurfacePoint, THICKNESS, above_which,
    fitted, towards,
};

/// Sparse points this far from the region's middle tell of the ground.
const AROUND: f32 = 2.5;
/// Triples that are tried; those at least this good beside the best so far are refined.
const GROUND_TRIALS: usize = 12_000;
const PROMISING: f32 = 0.6;
/// Points this near lie on the ground.
const ON_GROUND: f32 = 0.012;
/// Share of points on the ground that it takes, and below it that rules it out.
const LEAST_ON: f32 = 0.03;
const MOST_BELOW: f32 = 0.1;
/// The share below it that makes points on it count half.
const HALVED_BELOW: f32 = 0.01;
/// How far below a ground of sparse points its surface is looked for, in the normalised frame.
const SETTLES: f32 = 0.2;
/// Share of what faces up at the best height that must do so at the points' own.
const BORNE_OUT: f32 = 0.5;
/// Sparse points that planes are tried on: of millions, all would take minutes and say the same.
const MOST_POINTS: usize = 50_000;

/// The plane that a scene stands on, by its sparse points (normalised, also from around the region):
/// many lie on it, hardly any below. Triangulated points are exact where surfaces learnt in a short
/// time are not, on a polished table above all.
#[must_use]
pub fn ground(points: &[Vec3], cameras: &[Vec3], seed: u64) -> Option<Plane> {
    let mut around: Vec<Vec3> = points
        .iter()
        .copied()
        .filter(|p| p.length() < AROUND)
        .collect();
    if around.len() < LEAST_POINTS {
        return None;
    }
    let stride = around.len().div_ceil(MOST_POINTS);
    around = around.into_iter().step_by(stride).collect();
    let score = |plane: &Plane| {
        let (mut on, mut below) = (0.0, 0.0);
        for p in &around {
            let height = plane.height(*p);
            on += f32::from(u8::from(height.abs() < ON_GROUND));
            below += f32::from(u8::from(height < -BELOW_GROUND));
        }
        let enough = on >= LEAST_ON * around.len() as f32 && plane.offset.abs() < 1.0;
        let below = below / around.len() as f32;
        let fair = (1.0 - below / MOST_BELOW) / (1.0 + below / HALVED_BELOW);
        if enough {
            on * fair * above_which(plane, cameras)
        } else {
            0.0
        }
    };
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x0012_00d0);
    let mut best: (f32, Option<Plane>) = (0.0, None);
    for _ in 0..GROUND_TRIALS {
        let [a, b, c]: [Vec3; 3] =
            std::array::from_fn(|_| around[random.random_range(0..around.len())]);
        let Some(mut plane) = through(a, b, c, cameras) else {
            continue;
        };
        if score(&plane) <= PROMISING * best.0 {
            continue;
        }
        // Three points alone tilt a plane: all those near it set it right.
        for _ in 0..3 {
            let found = score(&plane);
            if found > best.0 {
                best = (found, Some(plane));
            }
            match fitted(&around, &plane, 2.0 * ON_GROUND, cameras) {
                Some(better) => plane = better,
                None => break,
            }
        }
    }
    best.1.map(|plane| Plane {
        thickness: THICKNESS[0],
        ..plane
    })
}

/// A `ground` of sparse points, moved down to where most of the fused surface is that faces up; all in the normalised frame.
///
/// Where the ground itself has no points, those of the things on it lie on planes as well, a little higher; and a ground
/// without points has no texture, so that its surface is as uneven as any. A plane that the surface bears out stays as it
/// is: points are the more exact.
#[must_use]
pub fn settled(ground: Plane, surface: &[SurfacePoint], cameras: &[Vec3]) -> Plane {
    let up: Vec<Vec3> = surface
        .iter()
        .filter(|p| ground.normal.dot(p.normal) > FACES_UP)
        .map(|p| p.at)
        .collect();
    let mut heights: Vec<f32> = up.iter().map(|p| ground.height(*p)).collect();
    heights.retain(|height| height.abs() <= SETTLES + NEAR);
    heights.sort_by(f32::total_cmp);
    let around = |height: f32| {
        let first = heights.partition_point(|h| *h < height - NEAR);
        let end = heights.partition_point(|h| *h <= height + NEAR);
        end - first
    };
    let best = heights
        .iter()
        .copied()
        .filter(|height| (-SETTLES..=0.0).contains(height))
        .max_by_key(|height| around(*height));
    let Some(best) = best.filter(|best| (around(0.0) as f32) < BORNE_OUT * around(*best) as f32)
    else {
        return ground;
    };
    let mut plane = Plane {
        offset: ground.offset + best,
        ..ground
    };
    for _ in 0..3 {
        match fitted(&up, &plane, NEAR, cameras) {
            Some(better) => plane = better,
            None => break,
        }
    }
    Plane {
        thickness: THICKNESS[1],
        ..plane
    }
}

fn through(a: Vec3, b: Vec3, c: Vec3, cameras: &[Vec3]) -> Option<Plane> {
    let normal = (b - a).cross(c - a).try_normalize()?;
    towards(normal, normal.dot(a), cameras)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::plane::tests::random_points;
    use super::*;

    #[test]
    fn the_ground_has_little_below_it() {
        // A cluttered table: as many points on a book's cover above it, few mirrored below.
        let mut points = random_points(4, 60, |[a, b, _]| Vec3::new(2.0 * a, 2.0 * b, -0.3));
        points.extend(random_points(5, 70, |[a, b, _]| {
            Vec3::new(0.4 * a, 0.4 * b, -0.1)
        }));
        points.extend(random_points(6, 400, |[a, b, c]| {
            Vec3::new(a, b, 0.25 + 0.5 * c)
        }));
        points.extend(random_points(7, 8, |[a, b, c]| {
            Vec3::new(a, b, -0.6 + 0.2 * c)
        }));
        let cameras: Vec<Vec3> = (0..12)
            .map(|i| Vec3::new(2.0 * (i as f32).sin(), 2.0 * (i as f32).cos(), 1.5))
            .collect();
        let plane = ground(&points, &cameras, 3).unwrap();
        assert!(plane.normal.z > 0.995, "{plane:?}");
        assert!(
            (plane.height(Vec3::new(0.0, 0.0, -0.3))).abs() < 0.02,
            "{plane:?}"
        );
        assert_eq!(ground(&points[..50], &cameras, 3), None);
    }

    #[test]
    fn an_objects_side_is_no_ground_nor_what_cuts_it() {
        // A box that leans to one side, with points all over it, on a table without any.
        let (low, high) = (Vec3::new(-0.3, -0.2, -0.2), Vec3::new(0.3, 0.2, 0.1));
        let lean = |p: Vec3| Vec3::new(p.x + 0.4 * (p.z - low.z), p.y, p.z);
        let on_box = |axis: usize, count: usize, seed: u64| {
            random_points(seed, count, move |[a, b, c]| {
                let mut share = [a, b, c].map(|v| 0.5 + 0.5 * v);
                share[axis] = share[axis].round();
                lean(low + Vec3::from(share) * (high - low))
            })
        };
        let sides = [on_box(0, 900, 11), on_box(1, 300, 12), on_box(2, 300, 13)].concat();
        // More cameras on one side than on the other, none below the table.
        let cameras: Vec<Vec3> = (0..30)
            .map(|i| 0.131 * i as f32 - 1.9)
            .map(|angle| Vec3::new(1.5 * angle.cos(), 1.5 * angle.sin(), 0.6))
            .collect();
        let plane = ground(&sides, &cameras, 5).unwrap();
        assert!(plane.normal.z > 0.995, "{plane:?}");
        assert!((plane.offset - low.z).abs() < 0.02, "{plane:?}");
    }

    #[test]
    fn a_ground_without_points_is_where_most_of_the_surface_faces_up() {
        let cameras = [Vec3::new(0.0, 2.0, 2.0), Vec3::new(2.0, 0.0, 2.0)];
        let flat = |seed: u64, count: usize, half: f32, height: f32| {
            random_points(seed, count, move |[a, b, c]| {
                Vec3::new(half * a, half * b, height + 0.03 * c)
            })
        };
        // A bare table, and a third as much of flat things on it.
        let surface: Vec<SurfacePoint> = flat(8, 2000, 1.0, -0.41)
            .into_iter()
            .chain(flat(9, 700, 0.5, -0.3))
            .map(|at| SurfacePoint {
                at,
                normal: Vec3::Z,
            })
            .collect();
        let of_points = |offset: f32| Plane {
            normal: Vec3::new(0.03, 0.0, 1.0).normalize(),
            offset,
            thickness: 0.02,
        };
        let found = settled(of_points(-0.31), &surface, &cameras);
        assert!(found.normal.z > 0.9999, "{found:?}");
        assert!((found.offset + 0.41).abs() < 0.005, "{found:?}");
        assert!(found.thickness > 0.05, "{found:?}");
        // What the surface bears out stays, also where more lies higher, and so it does where nothing faces up.
        assert_eq!(
            settled(of_points(-0.4), &surface, &cameras),
            of_points(-0.4)
        );
        let higher = flat(10, 9000, 0.5, -0.3)
            .into_iter()
            .map(|at| SurfacePoint {
                at,
                normal: Vec3::Z,
            });
        let with_higher: Vec<SurfacePoint> = surface.iter().copied().chain(higher).collect();
        assert_eq!(
            settled(of_points(-0.4), &with_higher, &cameras),
            of_points(-0.4)
        );
        assert_eq!(settled(of_points(-0.31), &[], &cameras), of_points(-0.31));
    }
}
