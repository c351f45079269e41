//! Triangle meshes from PLY files: ASCII or binary, any number type, polygons cut into fans.

use crate::EvalError;
use crate::mesh::TriangleMesh;
use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Header, Property, PropertyAccess, PropertyAccessResult};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Coordinates beyond this are of no object. Distances take products of four of them, which have to stay finite.
const FARTHEST: f64 = 1e30;

/// Reads the elements `vertex` (`x`, `y`, `z`) and `face` (`vertex_indices` or `vertex_index`);
/// all else in the file is skipped. A file without faces is a mesh without triangles.
pub fn read_ply(path: &Path) -> Result<TriangleMesh, EvalError> {
    read(path).map_err(|reason| EvalError::Mesh {
        path: path.to_owned(),
        // The parser's messages span lines and quote the file.
        reason: reason.split_whitespace().collect::<Vec<_>>().join(" "),
    })
}

fn read(path: &Path) -> Result<TriangleMesh, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut reader = Reader::new(BufReader::new(file));
    let vertex_parser = Parser::<Vertex>::new();
    let header = vertex_parser
        .read_header(&mut reader)
        .map_err(|e| e.to_string())?;
    refuse_endless(&header)?;
    let mut mesh = TriangleMesh::default();
    let mut polygons = Vec::new();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let vertices =
                    vertex_parser.read_payload_for_element(&mut reader, element, &header);
                let vertices = vertices.map_err(|e| e.to_string())?;
                mesh.vertices = vertices.into_iter().map(|v| v.0).collect();
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
    if let Some(bad) = mesh.vertices.iter().position(|v| !v.is_finite()) {
        return Err(format!("vertex {bad} has no finite x, y and z"));
    }
    let is_far = |v: &DVec3| v.abs().max_element() > FARTHEST;
    if let Some(bad) = mesh.vertices.iter().position(is_far) {
        return Err(format!(
            "vertex {bad} lies more than {FARTHEST:e} away, where no object is"
        ));
    }
    for (number, Face(corners)) in polygons.iter().enumerate() {
        if let Some(bad) = corners
            .iter()
            .find(|&&i| i < 0 || i >= mesh.vertices.len() as i64)
        {
            return Err(format!(
                "face {number} names vertex {bad} of {}",
                mesh.vertices.len()
            ));
        }
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            mesh.triangles
                .push([corners[0], pair[0], pair[1]].map(|i| i as u32));
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

/// Coordinates the file lacks stay NaN, which the check above reports.
struct Vertex(DVec3);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(DVec3::NAN)
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let target = match name {
            "x" => &mut self.0.x,
            "y" => &mut self.0.y,
            "z" => &mut self.0.z,
            _ => return PropertyAccessResult::Ignored,
        };
        *target = match value {
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
