//! The run's mesh in memory: read from `mesh.ply`, completed and checked.

use crate::error::ExportError;
use crate::run::resumed;
use glam::{DVec3, Vec3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Header, Property, PropertyAccess, PropertyAccessResult};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Below this length a normal has no direction.
const SHORT: f32 = 1e-6;

/// The object's surface in the scene's own frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertices, in scene units.
    pub positions: Vec<DVec3>,
    /// Unit length, one per vertex.
    pub normals: Vec<Vec3>,
    /// sRGB, one per vertex.
    pub colours: Vec<[u8; 3]>,
    /// Three vertices each, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Reads a run's mesh.
    ///
    /// # Errors
    /// [`ExportError`] if it is missing, damaged or without triangles.
    pub fn of_run(root: &Path) -> Result<Self, ExportError> {
        let path = root.join("mesh.ply");
        if !path.is_file() {
            return Err(ExportError::bad(
                &path,
                "the run has no mesh, which it writes at its end where it found a surface",
                format!("let it come to its end: {}", resumed(root)),
            ));
        }
        let mesh = read(&path).map_err(|what| {
            let remedy = format!("make the run's results again: {}", resumed(root));
            ExportError::bad(&path, what, remedy)
        })?;
        if mesh.triangles.is_empty() {
            return Err(ExportError::bad(
                &path,
                "the mesh has no triangles: the run found no surface",
                "train for longer, or with masks that show the object",
            ));
        }
        Ok(mesh)
    }

    /// The corners of the box around all vertices.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for position in &self.positions {
            low = low.min(*position);
            high = high.max(*position);
        }
        (low, high)
    }

    /// Gives every vertex a normal of unit length, from the triangles around it where it has none.
    fn complete_normals(&mut self) {
        if self.normals.iter().all(|n| n.length() > SHORT) {
            self.normals.iter_mut().for_each(|n| *n = n.normalize());
            return;
        }
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|i| self.positions[i as usize]);
            // Its length is twice the triangle's area, by which it counts.
            let normal = (b - a).cross(c - a);
            for i in corners {
                sums[*i as usize] += normal;
            }
        }
        for (normal, sum) in self.normals.iter_mut().zip(sums) {
            *normal = if normal.length() > SHORT {
                normal.normalize()
            } else {
                // A vertex that no triangle uses gets any direction.
                sum.normalize_or(DVec3::Z).as_vec3()
            };
        }
    }
}

fn read(path: &Path) -> Result<Mesh, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut reader = Reader::new(BufReader::new(file));
    let vertex_parser = Parser::<Vertex>::new();
    let header = vertex_parser
        .read_header(&mut reader)
        .map_err(|e| e.to_string())?;
    refuse_endless(&header)?;
    let mut mesh = Mesh::default();
    let mut polygons = Vec::new();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let vertices =
                    vertex_parser.read_payload_for_element(&mut reader, element, &header);
                for vertex in vertices.map_err(|e| e.to_string())? {
                    mesh.positions.push(DVec3::from(vertex.position));
                    mesh.normals.push(Vec3::from(vertex.normal));
                    mesh.colours.push(vertex.colour);
                }
            }
            "face" => {
                let faces =
                    Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header);
                polygons = faces.map_err(|e| e.to_string())?;
            }
            _ => {
                let skipped = Parser::<Skipped>::new().read_payload_for_element(
                    &mut reader,
                    element,
                    &header,
                );
                skipped.map_err(|e| e.to_string())?;
            }
        }
    }
    // What is written holds 32-bit numbers.
    let is_finite = |v: &DVec3| v.as_vec3().is_finite();
    if let Some(bad) = mesh.positions.iter().position(|v| !is_finite(v)) {
        return Err(format!("vertex {bad} has no finite x, y and z"));
    }
    for (number, Face(corners)) in polygons.iter().enumerate() {
        let count = mesh.positions.len();
        if let Some(bad) = corners.iter().find(|&&i| i < 0 || i >= count as i64) {
            return Err(format!("face {number} names vertex {bad} of {count}"));
        }
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            mesh.triangles
                .push([corners[0], pair[0], pair[1]].map(|i| i as u32));
        }
    }
    mesh.normals
        .iter_mut()
        .filter(|n| !n.is_finite())
        .for_each(|n| *n = Vec3::ZERO);
    mesh.complete_normals();
    Ok(mesh)
}

/// Refuses entries that take no bytes: the parser would read as many of them as the file claims, without ever
/// coming to its end.
fn refuse_endless(header: &Header) -> Result<(), String> {
    let mut elements = header.elements.values();
    match elements.find(|element| element.count > 0 && element.properties.is_empty()) {
        Some(element) => Err(format!(
            "it claims {} of the element {:?}, which has no properties",
            element.count, element.name
        )),
        None => Ok(()),
    }
}

/// What the file lacks stays as it is here: a position that is refused, no normal, white.
struct Vertex {
    position: [f64; 3],
    normal: [f32; 3],
    colour: [u8; 3],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self {
            position: [f64::NAN; 3],
            normal: [0.0; 3],
            colour: [255; 3],
        }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let number = match value {
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        let at = |names: [&str; 3]| names.iter().position(|known| *known == name);
        if let Some(axis) = at(["x", "y", "z"]) {
            self.position[axis] = number;
        } else if let Some(axis) = at(["nx", "ny", "nz"]) {
            self.normal[axis] = number as f32;
        } else if let Some(channel) = at(["red", "green", "blue"]) {
            self.colour[channel] = number.clamp(0.0, 255.0) as u8;
        } else {
            return PropertyAccessResult::Ignored;
        }
        PropertyAccessResult::Set
    }
}

struct Face(Vec<i64>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.0 = match value {
            Property::ListChar(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUChar(v) => v.into_iter().map(i64::from).collect(),
            Property::ListShort(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUShort(v) => v.into_iter().map(i64::from).collect(),
            Property::ListInt(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUInt(v) => v.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_that_are_missing_come_from_the_triangles() {
        let mut mesh = Mesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE],
            normals: vec![Vec3::ZERO, Vec3::ZERO, Vec3::X * 3.0, Vec3::ZERO],
            colours: vec![[255; 3]; 4],
            triangles: vec![[0, 1, 2]],
        };
        mesh.complete_normals();
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::X, Vec3::Z]);
    }
}
