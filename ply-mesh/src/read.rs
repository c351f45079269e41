//! Meshes from files of any encoding.

use crate::vertex::Vertex;
use crate::{Mesh, PlyError};
use glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Header, Property, PropertyAccess, PropertyAccessResult};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

impl Mesh {
    /// Reads the elements `vertex` (`x`, `y`, `z` and, where there are any, `nx`, `ny`, `nz`, `red`, `green`, `blue`)
    /// and `face` (`vertex_indices` or `vertex_index`); all else in the file is skipped. A file without faces is a mesh
    /// without triangles. Normals stay as they are; what is no number is none.
    ///
    /// # Errors
    /// [`PlyError`] if the file cannot be read, is cut off or no PLY file, if a position is not finite, or if a face
    /// names a vertex that does not exist.
    pub fn read(path: &Path) -> Result<Self, PlyError> {
        read(path).map_err(|reason| PlyError {
            path: path.to_owned(),
            // The parser's messages span lines and quote the file.
            reason: reason.split_whitespace().collect::<Vec<_>>().join(" "),
        })
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
                    mesh.positions.push(vertex.position);
                    mesh.normals.push(vertex.normal);
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
    if let Some(bad) = mesh.positions.iter().position(|v| !v.is_finite()) {
        return Err(format!("vertex {bad} has no finite x, y and z"));
    }
    let missing = mesh.normals.iter_mut().filter(|n| !n.is_finite());
    missing.for_each(|n| *n = Vec3::ZERO);
    let count = mesh.positions.len();
    for (number, Face(corners)) in polygons.iter().enumerate() {
        if let Some(bad) = corners.iter().find(|&&i| i < 0 || i >= count as i64) {
            return Err(format!("face {number} names vertex {bad} of {count}"));
        }
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            let triangle = [corners[0], pair[0], pair[1]].map(|i| i as u32);
            mesh.triangles.push(triangle);
        }
    }
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
