//! The planes that things stand on or before: found by random samples (RANSAC, Fischler and Bolles
//! 1981) among sparse points, or else among those of fused surfaces.

use glam::{Mat3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::normal::normal;

/// A plane that is kept out of the object, all that is behind it included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, towards the cameras.
    pub normal: Vec3,
    /// `normal . p` of its points.
    pub offset: f32,
    /// How far from it its points may be.
    pub thickness: f32,
}

impl Plane {
    /// Signed height above the plane.
    #[must_use]
    pub fn height(&self, point: Vec3) -> f32 {
        self.normal.dot(point) - self.offset
    }
}

/// Points of surfaces that are tried, and by how many each is judged.
const SURFACE_TRIALS: usize = 600;
const JUDGES: usize = 4000;
/// Points this near speak for a plane, in the normalised frame.
const NEAR: f32 = 0.025;
/// Cosine of a normal with the plane's above which a surface counts as part of it.
const FACES_UP: f32 = 0.85;
/// Bounds of a plane's thickness, and how many of its points' deviations it is: shiny tables come out
/// uneven.
const THICKNESS: [f32; 2] = [0.02, 0.06];
const DEVIATIONS: f32 = 3.0;
/// Share of all surface points that makes a plane, and below it that rules it out: undersides and what
/// is mirrored are there, too.
const LEAST_SURFACE: f32 = 0.02;
const MOST_SURFACE_BELOW: f32 = 0.3;
/// Share of its points that must lie at the region's border: a support goes on, an object's side ends.
const LEAST_BORDER: f32 = 0.04;
/// Where the border begins.
const BORDER: f32 = 0.88;
/// Share of the cameras that must be on its upper side.
const LEAST_CAMERAS: f32 = 0.8;
/// Sparse points this far from the region's middle tell of the ground.
const AROUND: f32 = 2.5;
/// Fewer say too little.
const LEAST_POINTS: usize = 100;
/// Triples that are tried; those at least this good beside the best so far are refined.
const GROUND_TRIALS: usize = 12_000;
const PROMISING: f32 = 0.6;
/// Points this near lie on the ground, and this far below it they speak against it.
const ON_GROUND: f32 = 0.012;
const BELOW_GROUND: f32 = 0.06;
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

/// A point of a fused surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where.
    pub at: Vec3,
    /// Outward unit normal.
    pub normal: Vec3,
}

/// Centres of the seen solid voxels that border on empty ones, of the fused distances `solid`
/// `[resolution^3]`.
#[must_use]
pub fn surface_points(solid: &[f32], resolution: usize) -> Vec<SurfacePoint> {
    let n = resolution;
    (0..solid.len())
        .filter_map(|cell| {
            let [x, y, z] = [cell % n, cell / n % n, cell / (n * n)];
            // Space beyond the region is not known to be empty.
            let inner = |v: usize| v > 0 && v + 1 < n;
            if solid[cell] >= 0.0 || !(inner(x) && inner(y) && inner(z)) {
                return None;
            }
            let steps = [1, n, n * n];
            let open = |step: &usize| solid[cell + step] > 0.0 || solid[cell - step] > 0.0;
            if !steps.iter().any(open) {
                return None;
            }
            let normal = normal(solid, cell, n);
            (normal != Vec3::ZERO).then(|| SurfacePoint {
                at: scene_decomp::probability::ProbabilityMap::centre(n, cell),
                normal,
            })
        })
        .collect()
}

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

/// The plane that a scene stands on by its fused surfaces, where there are no sparse points: much lies on it and faces
/// up, little below, and it goes on to the region's border.
#[must_use]
pub fn ground_of_surface(surface: &[SurfacePoint], cameras: &[Vec3], seed: u64) -> Option<Plane> {
    let stride = (surface.len() / JUDGES).max(1);
    let judges: Vec<SurfacePoint> = surface.iter().copied().step_by(stride).collect();
    if judges.len() < LEAST_POINTS {
        return None;
    }
    let on = |plane: &Plane, p: &SurfacePoint| {
        plane.height(p.at).abs() <= NEAR && plane.normal.dot(p.normal) > FACES_UP
    };
    let score = |plane: &Plane| {
        let (mut count, mut border, mut below) = (0.0, 0.0, 0.0);
        for p in &judges {
            if on(plane, p) {
                count += 1.0;
                border += f32::from(u8::from(p.at.abs().max_element() > BORDER));
            }
            below += f32::from(u8::from(plane.height(p.at) < -BELOW_GROUND));
        }
        let all = judges.len() as f32;
        let enough = count >= LEAST_SURFACE * all && border >= LEAST_BORDER * count;
        if enough {
            count * (1.0 - below / (MOST_SURFACE_BELOW * all)) * above_which(plane, cameras)
        } else {
            0.0
        }
    };
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x0009_1a4e);
    let mut best: (f32, Option<Plane>) = (0.0, None);
    for _ in 0..SURFACE_TRIALS {
        let p = judges[random.random_range(0..judges.len())];
        let Some(mut plane) = towards(p.normal, p.normal.dot(p.at), cameras) else {
            continue;
        };
        for _ in 0..3 {
            let near: Vec<Vec3> = judges
                .iter()
                .filter(|p| on(&plane, p))
                .map(|p| p.at)
                .collect();
            match fitted(&near, &plane, NEAR, cameras) {
                Some(better) => plane = better,
                None => break,
            }
        }
        let found = score(&plane);
        if found > best.0 {
            best = (found, Some(plane));
        }
    }
    let plane = best.1?;
    let mut heights: Vec<f32> = surface
        .iter()
        .filter(|p| plane.normal.dot(p.normal) > FACES_UP)
        .map(|p| plane.height(p.at).abs())
        .filter(|height| *height <= THICKNESS[1])
        .collect();
    heights.sort_by(f32::total_cmp);
    // The median of absolute deviations, as a standard deviation.
    let deviation = 1.48 * heights.get(heights.len() / 2)?;
    Some(Plane {
        thickness: (DEVIATIONS * deviation).clamp(THICKNESS[0], THICKNESS[1]),
        ..plane
    })
}

fn through(a: Vec3, b: Vec3, c: Vec3, cameras: &[Vec3]) -> Option<Plane> {
    let normal = (b - a).cross(c - a).try_normalize()?;
    towards(normal, normal.dot(a), cameras)
}

/// The plane with its normal on the cameras' side, if most of them are on one.
fn towards(normal: Vec3, offset: f32, cameras: &[Vec3]) -> Option<Plane> {
    let plane = Plane {
        normal,
        offset,
        thickness: NEAR,
    };
    let above = cameras.iter().filter(|c| plane.height(**c) > 0.0).count();
    let most = (LEAST_CAMERAS * cameras.len() as f32) as usize;
    if above >= most {
        Some(plane)
    } else if cameras.len() - above >= most {
        Some(Plane {
            normal: -normal,
            offset: -offset,
            ..plane
        })
    } else {
        None
    }
}

/// How much a plane counts by the cameras above it: 1 where all of them are, 0 where it is the least share.
///
/// Nobody photographs from below the ground; a few only seem to. An object's side has few points behind it, too, but a capture
/// all around has cameras there.
fn above_which(plane: &Plane, cameras: &[Vec3]) -> f32 {
    let below = cameras.iter().filter(|c| plane.height(**c) <= 0.0).count();
    (1.0 - below as f32 / ((1.0 - LEAST_CAMERAS) * cameras.len() as f32)).max(0.0)
}

/// Least squares through the points within `reach` of `plane`.
fn fitted(points: &[Vec3], plane: &Plane, reach: f32, cameras: &[Vec3]) -> Option<Plane> {
    let near: Vec<Vec3> = points
        .iter()
        .copied()
        .filter(|p| plane.height(*p).abs() <= reach)
        .collect();
    let mean = near.iter().sum::<Vec3>() / near.len().max(1) as f32;
    let mut scatter = Mat3::ZERO;
    for p in &near {
        let d = *p - mean;
        scatter += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    // The normal is the direction of least scatter: the largest of what the trace leaves.
    let trace = scatter.x_axis.x + scatter.y_axis.y + scatter.z_axis.z;
    let rest = Mat3::from_diagonal(Vec3::splat(trace)) - scatter;
    let mut normal = plane.normal;
    for _ in 0..200 {
        normal = (rest * normal).try_normalize()?;
    }
    towards(normal, normal.dot(mean), cameras)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn random_points(seed: u64, count: usize, make: impl Fn([f32; 3]) -> Vec3) -> Vec<Vec3> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        (0..count)
            .map(|_| make(std::array::from_fn(|_| random.random_range(-1.0f32..1.0))))
            .collect()
    }

    #[test]
    fn a_table_is_found_and_a_cube_on_it_is_not() {
        let normal = Vec3::new(0.1, 0.9, -0.2).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let table = random_points(1, 1500, |[a, b, c]| {
            a * u + b * v + (0.005 * c - 0.4) * normal
        });
        let mut surface: Vec<SurfacePoint> = table
            .into_iter()
            .map(|at| SurfacePoint { at, normal })
            .collect();
        // The sides of a cube, none of which reaches the border.
        for k in 0..3 {
            let side = random_points(2 + k, 1200, |[a, b, c]| {
                let mut p = 0.3 * Vec3::new(a, b, c);
                p[k as usize] = 0.3 * c.signum();
                p
            });
            surface.extend(side.into_iter().map(|at| {
                let mut normal = Vec3::ZERO;
                normal[k as usize] = at[k as usize].signum();
                SurfacePoint { at, normal }
            }));
        }
        let cameras: Vec<Vec3> = (0..20)
            .map(|i| 3.0 * (0.7 * normal + (i as f32).sin() * u + (i as f32).cos() * v))
            .collect();
        let plane = ground_of_surface(&surface, &cameras, 7).unwrap();
        assert!(plane.normal.dot(normal) > 0.999, "{plane:?}");
        assert!((plane.offset + 0.4).abs() < 0.01, "{plane:?}");
    }

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

    #[test]
    fn a_ball_has_no_plane() {
        let points = random_points(3, 5000, |p| Vec3::from(p).normalize_or(Vec3::X) * 0.9);
        let ball: Vec<SurfacePoint> = points
            .into_iter()
            .map(|at| SurfacePoint {
                at,
                normal: at.normalize(),
            })
            .collect();
        assert_eq!(ground_of_surface(&ball, &[Vec3::Z * 4.0], 1), None);
        assert_eq!(ground_of_surface(&[], &[Vec3::Z * 4.0], 1), None);
    }

    #[test]
    fn surfaces_are_where_solid_meets_empty() {
        let n = 8;
        let solid: Vec<f32> = (0..n * n * n)
            .map(|cell| if cell / (n * n) < 4 { -1.0 } else { 1.0 })
            .collect();
        let points = surface_points(&solid, n);
        assert_eq!(points.len(), (n - 2) * (n - 2));
        assert!(
            points
                .iter()
                .all(|p| (p.at.z + 0.125).abs() < 1e-6 && p.normal == Vec3::Z)
        );
    }
}
