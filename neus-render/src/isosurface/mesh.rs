//! A triangle mesh with shared vertices, its measures and its connected parts.

use glam::{Affine3A, Vec3};
use serde::{Deserialize, Serialize};

/// Triangles over shared vertices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Where the vertices are; `[v]`.
    pub positions: Vec<Vec3>,
    /// Unit normals that point out of the solid; `[v]`.
    pub normals: Vec<Vec3>,
    /// Vertex numbers, counter-clockwise seen from outside; `[f]`.
    pub triangles: Vec<[u32; 3]>,
}

/// By what the parts of a mesh are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Measure {
    /// Surface area.
    Area,
    /// Enclosed volume, in absolute value; meaningful for closed parts.
    Volume,
}

impl Mesh {
    /// The surface area.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|&t| self.triangle_area(t)).sum()
    }

    /// The enclosed volume, for closed meshes; hollows count negative.
    pub fn volume(&self) -> f64 {
        let triangles = self.triangles.iter();
        triangles.map(|&t| self.triangle_volume(t)).sum()
    }

    /// Moves the mesh to another frame. Turns, shifts and uniform scales keep normals right, others
    /// don't; a mirroring transform also swaps the triangles' orientation.
    pub fn transform(&mut self, to_from: &Affine3A) {
        for p in &mut self.positions {
            *p = to_from.transform_point3(*p);
        }
        for n in &mut self.normals {
            *n = to_from.transform_vector3(*n).normalize_or_zero();
        }
        if to_from.matrix3.determinant() < 0.0 {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
    }

    /// Keeps the connected parts that have at least `share` (in [0, 1]) of the largest one's
    /// measure, and drops vertices that no triangle uses. How many parts were dropped.
    ///
    /// ```
    /// use glam::Vec3;
    /// use neus_render::{
    ///     field::FnSdf,
    ///     intersect::Aabb,
    ///     isosurface::{IsosurfaceConfig, Measure, extract_isosurface},
    /// };
    ///
    /// let big = |p: Vec3| (p + 0.3).length() - 0.4;
    /// let small = |p: Vec3| (p - 0.6).length() - 0.1;
    /// let config = IsosurfaceConfig { resolution: 48, ..IsosurfaceConfig::default() };
    /// let field = FnSdf(|p: Vec3| big(p).min(small(p)));
    /// let mut mesh = extract_isosurface(&field, &Aabb::UNIT, &config)?;
    /// assert_eq!(mesh.keep_large_parts(Measure::Volume, 0.1), 1);
    /// assert!(mesh.positions.iter().all(|p| p.max_element() < 0.2));
    /// # Ok::<(), neus_render::isosurface::IsosurfaceError>(())
    /// ```
    pub fn keep_large_parts(&mut self, measure: Measure, share: f64) -> usize {
        let parts = self.parts();
        let mut sizes = vec![0.0; self.positions.len()];
        for &t in &self.triangles {
            sizes[parts[t[0] as usize] as usize] += match measure {
                Measure::Area => self.triangle_area(t),
                Measure::Volume => self.triangle_volume(t),
            };
        }
        let largest = sizes.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let keep = |part: u32| sizes[part as usize].abs() >= share * largest;
        let mut dropped: Vec<u32> = self
            .triangles
            .iter()
            .map(|t| parts[t[0] as usize])
            .filter(|&part| !keep(part))
            .collect();
        self.triangles.retain(|t| keep(parts[t[0] as usize]));
        self.drop_unused_vertices();
        dropped.sort_unstable();
        dropped.dedup();
        dropped.len()
    }

    /// For every vertex the number of its connected part: that part's smallest vertex. `[v]`
    pub fn parts(&self) -> Vec<u32> {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        fn root(parent: &mut [u32], mut i: u32) -> u32 {
            while parent[i as usize] != i {
                let up = parent[parent[i as usize] as usize];
                parent[i as usize] = up;
                i = up;
            }
            i
        }
        for &[a, b, c] in &self.triangles {
            for other in [b, c] {
                let (i, j) = (root(&mut parent, a), root(&mut parent, other));
                // The smaller number leads, so that the answer doesn't depend on the order.
                parent[i.max(j) as usize] = i.min(j);
            }
        }
        for i in 0..parent.len() as u32 {
            parent[i as usize] = root(&mut parent, i);
        }
        parent
    }

    fn drop_unused_vertices(&mut self) {
        const UNUSED: u32 = u32::MAX;
        let mut numbers = vec![UNUSED; self.positions.len()];
        for &i in self.triangles.iter().flatten() {
            numbers[i as usize] = 0;
        }
        let mut count = 0;
        for (old, number) in numbers.iter_mut().enumerate() {
            if *number != UNUSED {
                self.positions.swap(count, old);
                self.normals.swap(count, old);
                *number = count as u32;
                count += 1;
            }
        }
        self.positions.truncate(count);
        self.normals.truncate(count);
        for i in self.triangles.iter_mut().flatten() {
            *i = numbers[*i as usize];
        }
    }

    fn corners(&self, triangle: [u32; 3]) -> [glam::DVec3; 3] {
        triangle.map(|i| self.positions[i as usize].as_dvec3())
    }

    fn triangle_area(&self, triangle: [u32; 3]) -> f64 {
        let [a, b, c] = self.corners(triangle);
        0.5 * (b - a).cross(c - a).length()
    }

    /// The signed volume of the tetrahedron with the origin.
    fn triangle_volume(&self, triangle: [u32; 3]) -> f64 {
        let [a, b, c] = self.corners(triangle);
        a.dot(b.cross(c)) / 6.0
    }
}
