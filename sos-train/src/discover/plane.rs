//! The planes that things stand on or before: found by random samples (RANSAC, Fischler and Bolles 1981) among points of fused
//! surfaces; those of [sparse points](super::sparse_ground) come first.

use glam::{Mat3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use scene_decomp::probability::ProbabilityMap;

use super::normal::normal;
use crate::median::median;

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

    /// Whether a point lies in it or behind it.
    #[must_use]
    pub(super) fn has(&self, point: Vec3) -> bool {
        self.height(point) <= self.thickness
    }

    /// Whether things stand on it, by the cameras' mean upward direction `up`, instead of before it, as before a wall: cameras
    /// look down on floors.
    #[must_use]
    pub fn is_level(&self, up: Vec3) -> bool {
        self.normal.dot(up) > LEVEL
    }
}

/// How high a voxel is above the ground, in voxels.
pub(super) fn height_above(ground: &Plane, resolution: usize) -> impl Fn(usize) -> f32 {
    let side = 0.5 * resolution as f32;
    move |cell| {
        let height = ground.height(ProbabilityMap::centre(resolution, cell));
        side * (height - ground.thickness)
    }
}

/// Points of surfaces that are tried, and by how many each is judged.
const SURFACE_TRIALS: usize = 600;
const JUDGES: usize = 4000;
/// Points this near speak for a plane, in the normalised frame.
pub(super) const NEAR: f32 = 0.025;
/// Cosine of a normal with the plane's above which a surface counts as part of it.
pub(super) const FACES_UP: f32 = 0.85;
/// Bounds of a plane's thickness, and how many of its points' deviations it is: shiny tables come out
/// uneven.
pub(super) const THICKNESS: [f32; 2] = [0.02, 0.06];
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
/// A plane whose normal agrees with the cameras' upward direction more than this is no wall.
const LEVEL: f32 = 0.3;
/// The same of a plane that things stand on before a wall, with the unit direction: who photographs a wall does not look down steeply.
const SUPPORTS: f32 = 0.7;
/// Fewer points say too little.
pub(super) const LEAST_POINTS: usize = 100;
/// Points this far below a plane speak against it.
pub(super) const BELOW_GROUND: f32 = 0.06;

/// A point of a fused surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where.
    pub at: Vec3,
    /// Outward unit normal.
    pub normal: Vec3,
}

impl SurfacePoint {
    fn lies_on(&self, plane: &Plane) -> bool {
        plane.height(self.at).abs() <= NEAR && plane.normal.dot(self.normal) > FACES_UP
    }

    fn is_at_border(&self) -> bool {
        self.at.abs().max_element() > BORDER
    }
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
                at: ProbabilityMap::centre(n, cell),
                normal,
            })
        })
        .collect()
}

/// The plane that a scene stands on by its fused surfaces, where no points tell: much lies on it and faces
/// up, little below, and it goes on to the region's border.
#[must_use]
pub fn ground_of_surface(surface: &[SurfacePoint], cameras: &[Vec3], seed: u64) -> Option<Plane> {
    best_plane(surface, cameras, seed, |_, below| {
        1.0 - below / MOST_SURFACE_BELOW
    })
}

/// The level plane that things stand on before a wall, by fused surfaces and the cameras' mean upward
/// direction: the top of a table or a shelf, below which there may be more of it.
#[must_use]
pub(super) fn support_of_surface(
    surface: &[SurfacePoint],
    cameras: &[Vec3],
    up: Vec3,
    seed: u64,
) -> Option<Plane> {
    best_plane(surface, cameras, seed, |plane, _| {
        f32::from(u8::from(
            plane.normal.dot(up.normalize_or_zero()) > SUPPORTS,
        ))
    })
}

/// The plane that most of a fused surface lies on and faces the same way, times what it is `worth` by the share of the surface
/// that is below it, of those that go on to the region's border and have the cameras above them.
fn best_plane(
    surface: &[SurfacePoint],
    cameras: &[Vec3],
    seed: u64,
    worth: impl Fn(&Plane, f32) -> f32,
) -> Option<Plane> {
    let stride = (surface.len() / JUDGES).max(1);
    let judges: Vec<SurfacePoint> = surface.iter().copied().step_by(stride).collect();
    if judges.len() < LEAST_POINTS {
        return None;
    }
    let score = |plane: &Plane| {
        let (mut count, mut border, mut below) = (0.0, 0.0, 0.0);
        for p in &judges {
            if p.lies_on(plane) {
                count += 1.0;
                border += f32::from(u8::from(p.is_at_border()));
            }
            below += f32::from(u8::from(plane.height(p.at) < -BELOW_GROUND));
        }
        let all = judges.len() as f32;
        let enough = count >= LEAST_SURFACE * all && border >= LEAST_BORDER * count;
        if enough {
            count * worth(plane, below / all) * above_which(plane, cameras)
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
                .filter(|p| p.lies_on(&plane))
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
    // The median of absolute deviations, as a standard deviation.
    let deviation = 1.48 * median(&mut heights)?;
    Some(Plane {
        thickness: (DEVIATIONS * deviation).clamp(THICKNESS[0], THICKNESS[1]),
        ..plane
    })
}

/// Whether a plane is a side of the thing that cameras look at instead of what that stands on: the region's middle lies behind
/// it, and the fused `surface` that lies on it ends before the region's border. Of too little surface nothing is known.
pub(super) fn is_side(plane: &Plane, surface: &[SurfacePoint]) -> bool {
    let on: Vec<_> = surface.iter().filter(|p| p.lies_on(plane)).collect();
    let border = on.iter().filter(|p| p.is_at_border()).count();
    let ends = on.len() >= LEAST_POINTS && (border as f32) < LEAST_BORDER * on.len() as f32;
    ends && plane.height(Vec3::ZERO) < 0.0
}

/// The plane with its normal on the cameras' side, if most of them are on one.
pub(super) fn towards(normal: Vec3, offset: f32, cameras: &[Vec3]) -> Option<Plane> {
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
pub(super) fn above_which(plane: &Plane, cameras: &[Vec3]) -> f32 {
    let below = cameras.iter().filter(|c| plane.height(**c) <= 0.0).count();
    (1.0 - below as f32 / ((1.0 - LEAST_CAMERAS) * cameras.len() as f32)).max(0.0)
}

/// Least squares through the points within `reach` of `plane`.
pub(super) fn fitted(
    points: &[Vec3],
    plane: &Plane,
    reach: f32,
    cameras: &[Vec3],
) -> Option<Plane> {
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
pub(super) mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    pub(in crate::discover) fn random_points(
        seed: u64,
        count: usize,
        make: impl Fn([f32; 3]) -> Vec3,
    ) -> Vec<Vec3> {
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
    fn a_things_front_is_told_from_a_wall_and_a_stand() {
        let flat = |seed: u64, half: f32, height: f32| {
            random_points(seed, 1500, move |[a, b, c]| {
                Vec3::new(half * a, half * b, height + 0.01 * c)
            })
        };
        let of = |points: Vec<Vec3>| -> Vec<SurfacePoint> {
            let facing = |at| SurfacePoint {
                at,
                normal: Vec3::Z,
            };
            points.into_iter().map(facing).collect()
        };
        let at = |offset: f32| Plane {
            normal: Vec3::Z,
            offset,
            thickness: NEAR,
        };
        assert!(is_side(&at(0.3), &of(flat(1, 0.4, 0.3))));
        // A wall goes on, on a stand stands what cameras look at, and of nothing nothing is known.
        assert!(!is_side(&at(0.3), &of(flat(2, 1.0, 0.3))));
        assert!(!is_side(&at(-0.3), &of(flat(3, 0.4, -0.3))));
        assert!(!is_side(&at(0.3), &[]));
    }

    #[test]
    fn a_shelf_before_a_wall_is_its_top() {
        let flat = |seed: u64, count: usize, normal: Vec3, make: fn([f32; 3]) -> Vec3| {
            let points = random_points(seed, count, make);
            points
                .into_iter()
                .map(move |at| SurfacePoint { at, normal })
        };
        let wall = flat(1, 2000, Vec3::NEG_Y, |[a, _, c]| Vec3::new(a, 0.6, c));
        let top = flat(2, 600, Vec3::Z, |[a, b, _]| {
            Vec3::new(a, 0.4 * b + 0.2, -0.3)
        });
        let front = flat(3, 1500, Vec3::NEG_Y, |[a, _, c]| {
            Vec3::new(a, -0.2, 0.35 * c - 0.65)
        });
        // A box's top, which ends.
        let cover = flat(4, 900, Vec3::Z, |[a, b, _]| {
            Vec3::new(0.3 * a, 0.2 * b + 0.2, 0.1)
        });
        let surface: Vec<SurfacePoint> = wall.chain(top).chain(front).chain(cover).collect();
        let cameras: Vec<Vec3> = (0..20)
            .map(|i| Vec3::new((i as f32).sin(), -3.0, 1.0 + (i as f32).cos()))
            .collect();
        let up = Vec3::new(0.0, 0.3, 0.95);
        let ground = ground_of_surface(&surface, &cameras, 7).unwrap();
        assert!(!ground.is_level(up), "{ground:?}");
        let support = support_of_surface(&surface, &cameras, up, 7).unwrap();
        assert!(support.is_level(up), "{support:?}");
        assert!((support.offset + 0.3).abs() < 0.01, "{support:?}");
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
