//! Distances between two surfaces.
//!
//! Points are drawn evenly by area on one mesh, and for each the distance to the other *surface* is
//! measured, point to triangle, exactly. Distances between two point samples, as often used, have a
//! floor: equal meshes do not get 0 but the spacing of the samples. Units are those of the meshes.

use crate::EvalError;
use crate::splitmix::SplitMix64;
use glam::DVec3;
use rayon::prelude::*;
use rstar::{AABB, PointDistance, RTree, RTreeObject};
use serde::{Deserialize, Serialize};

/// Points drawn on each mesh unless told otherwise.
pub const MESH_SAMPLES: usize = 100_000;

/// Vertices, and triangles that index them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Positions `[n_vertices, 3]`.
    pub vertices: Vec<DVec3>,
    /// Indices of corners `[n_triangles, 3]`, each below `n_vertices`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    fn corners(&self) -> impl Iterator<Item = Triangle> + '_ {
        self.triangles
            .iter()
            .map(|t| Triangle(t.map(|i| self.vertices[i as usize])))
    }

    /// Diagonal of the bounding box of all triangles; 0 without triangles.
    pub fn diagonal(&self) -> f64 {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in self.corners().flat_map(|t| t.0) {
            low = low.min(corner);
            high = high.max(corner);
        }
        if low.x <= high.x {
            low.distance(high)
        } else {
            0.0
        }
    }
}

/// Distances between a predicted and the true surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceDistance {
    /// Mean distance from predicted points to the true surface.
    pub accuracy_mean: f64,
    /// Median of the same.
    pub accuracy_median: f64,
    /// Mean distance from true points to the predicted surface.
    pub completeness_mean: f64,
    /// Median of the same.
    pub completeness_median: f64,
    /// Mean of the two means.
    pub chamfer: f64,
}

/// [`SurfaceDistance`] in the meshes' unit and as a share of the object's size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeshScore {
    /// Diagonal of the true mesh's bounding box.
    pub object_size: f64,
    /// In the unit of the meshes.
    pub absolute: SurfaceDistance,
    /// Divided by `object_size`.
    pub relative: SurfaceDistance,
}

/// Points `[n, 3]` spread over the surface in proportion to area, reproducible from `seed`.
///
/// Point `i` of `n` falls on the triangle at the share `(i + u) / n` of the cumulated area,
/// `u` uniform in 0..1 (stratified: every piece gets its share to within one point), and within it
/// at `(1 - sqrt r1) A + sqrt r1 (1 - r2) B + sqrt r1 r2 C`. Empty for a mesh without area.
pub fn sample_surface(mesh: &TriangleMesh, n: usize, seed: u64) -> Vec<DVec3> {
    let triangles: Vec<Triangle> = mesh.corners().filter(|t| t.area() > 0.0).collect();
    let total: f64 = triangles.iter().map(Triangle::area).sum();
    let Some(mut triangle) = triangles.first() else {
        return Vec::new();
    };
    let mut upper = triangle.area();
    let mut index = 0;
    let mut random = SplitMix64::new(seed);
    let mut points = Vec::with_capacity(n);
    for i in 0..n {
        let target = (i as f64 + random.uniform()) / n as f64 * total;
        while upper < target && index + 1 < triangles.len() {
            index += 1;
            triangle = &triangles[index];
            upper += triangle.area();
        }
        let (s, r2) = (random.uniform().sqrt(), random.uniform());
        let [a, b, c] = triangle.0;
        points.push(a * (1.0 - s) + b * (s * (1.0 - r2)) + c * (s * r2));
    }
    points
}

/// Accuracy, completeness and chamfer distance of `pred` against `truth` from `samples` points on each.
///
/// `accuracy = mean over p on pred of min over q on truth |p - q|`, completeness the other way round,
/// `chamfer = (accuracy + completeness) / 2`.
///
/// ```
/// use sos_eval::{TriangleMesh, compare_meshes, glam::DVec3};
/// let square = |z: f64| TriangleMesh {
///     vertices: [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(x, y)| DVec3::new(x, y, z)).to_vec(),
///     triangles: vec![[0, 1, 2], [0, 2, 3]],
/// };
/// let score = compare_meshes(&square(0.1), &square(0.0), 1000, 1)?;
/// assert!((score.absolute.chamfer - 0.1).abs() < 1e-12);
/// # Ok::<(), sos_eval::EvalError>(())
/// ```
///
/// # Errors
/// [`EvalError::EmptyMesh`] for a mesh without a surface.
///
/// # Panics
/// Without samples.
pub fn compare_meshes(
    pred: &TriangleMesh,
    truth: &TriangleMesh,
    samples: usize,
    seed: u64,
) -> Result<MeshScore, EvalError> {
    assert!(samples > 0, "compare_meshes: no samples");
    let (on_pred, on_truth) = (
        sample_surface(pred, samples, seed),
        sample_surface(truth, samples, seed),
    );
    if on_pred.is_empty() {
        return Err(EvalError::EmptyMesh { which: "predicted" });
    }
    if on_truth.is_empty() {
        return Err(EvalError::EmptyMesh { which: "true" });
    }
    let (accuracy_mean, accuracy_median) = mean_and_median(distances(&on_pred, truth));
    let (completeness_mean, completeness_median) = mean_and_median(distances(&on_truth, pred));
    let chamfer = 0.5 * (accuracy_mean + completeness_mean);
    let absolute = SurfaceDistance {
        accuracy_mean,
        accuracy_median,
        completeness_mean,
        completeness_median,
        chamfer,
    };
    let object_size = truth.diagonal();
    let relative = SurfaceDistance {
        accuracy_mean: accuracy_mean / object_size,
        accuracy_median: accuracy_median / object_size,
        completeness_mean: completeness_mean / object_size,
        completeness_median: completeness_median / object_size,
        chamfer: chamfer / object_size,
    };
    Ok(MeshScore {
        object_size,
        absolute,
        relative,
    })
}

/// Distance from each point `[n, 3]` to the nearest point of the surface. Triangles without
/// area are left out: what they touch belongs to their neighbours too.
pub fn distances(points: &[DVec3], surface: &TriangleMesh) -> Vec<f64> {
    let tree = RTree::bulk_load(surface.corners().filter(|t| t.area() > 0.0).collect());
    let nearest = |p: &DVec3| tree.nearest_neighbor_with_distance_2(p.to_array());
    points
        .par_iter()
        .map(|p| nearest(p).map_or(f64::INFINITY, |(_, d2)| d2.sqrt()))
        .collect()
}

fn mean_and_median(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    let median = 0.5 * (values[(n - 1) / 2] + values[n / 2]);
    (values.iter().sum::<f64>() / n as f64, median)
}

struct Triangle([DVec3; 3]);

impl Triangle {
    fn area(&self) -> f64 {
        let [a, b, c] = self.0;
        0.5 * (b - a).cross(c - a).length()
    }

    /// The nearest point of the triangle, by the region of its plane that `p` falls into
    /// (Ericson, Real-Time Collision Detection, 5.1.5).
    fn closest(&self, p: DVec3) -> DVec3 {
        let [a, b, c] = self.0;
        let (ab, ac) = (b - a, c - a);
        let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
        if d1 <= 0.0 && d2 <= 0.0 {
            return a;
        }
        let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
        if d3 >= 0.0 && d4 <= d3 {
            return b;
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return a + ab * (d1 / (d1 - d3));
        }
        let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
        if d6 >= 0.0 && d5 <= d6 {
            return c;
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return a + ac * (d2 / (d2 - d6));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 >= d3 && d5 >= d6 {
            return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
        }
        a + ab * (vb / (va + vb + vc)) + ac * (vc / (va + vb + vc))
    }
}

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b, c] = self.0;
        AABB::from_corners(a.min(b).min(c).to_array(), a.max(b).max(c).to_array())
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, point: &[f64; 3]) -> f64 {
        let p = DVec3::from_array(*point);
        self.closest(p).distance_squared(p)
    }
}
