//! `mesh.ply`.

use super::ExportError;
use crate::run_folder::RunFolder;
use ply_rs_bw::ply::{
    Addable as _, ElementDef, Encoding, Header, PropertyAccess, PropertyDef, PropertyType,
    ScalarType,
};
use ply_rs_bw::writer::Writer;
use std::io::{self, Write};

/// Vertex coordinates may be this many times larger than the mesh's extent before `float` is too
/// coarse for them: a step of it is then 1/8000 of the extent.
const FLOAT_IS_ENOUGH: f64 = 1000.0;

/// The object's surface in the scene's own frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WorldMesh {
    /// Vertices, in scene units.
    pub positions: Vec<[f64; 3]>,
    /// Unit normals, pointing outwards; one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// sRGB; one per vertex.
    pub colours: Vec<[u8; 3]>,
    /// Three vertices each, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Writes `mesh.ply`: binary little-endian, with normals and colours. Coordinates are `float`, or
/// `double` where the mesh lies so far from the origin that `float` would round it visibly.
///
/// # Errors
/// [`ExportError::Run`].
///
/// # Panics
/// If normals or colours are not one per vertex, or a triangle names a vertex that does not exist.
pub fn write_mesh(run: &RunFolder, mesh: &WorldMesh) -> Result<(), ExportError> {
    let vertices = mesh.positions.len();
    assert_eq!(
        mesh.normals.len(),
        vertices,
        "write_mesh: normals are not one per vertex"
    );
    assert_eq!(
        mesh.colours.len(),
        vertices,
        "write_mesh: colours are not one per vertex"
    );
    assert!(
        mesh.triangles
            .iter()
            .flatten()
            .all(|i| (*i as usize) < vertices),
        "write_mesh: a triangle names a vertex beyond the {vertices} there are"
    );
    Ok(run.write(&run.mesh_path(), |out| encode(out, mesh))?)
}

fn encode(out: &mut impl Write, mesh: &WorldMesh) -> io::Result<()> {
    let coordinate = if needs_double(&mesh.positions) {
        ScalarType::Double
    } else {
        ScalarType::Float
    };
    let vertex = element(
        "vertex",
        mesh.positions.len(),
        ["x", "y", "z"]
            .map(|name| (name, coordinate.clone()))
            .into_iter()
            .chain(["nx", "ny", "nz"].map(|name| (name, ScalarType::Float)))
            .chain(["red", "green", "blue"].map(|name| (name, ScalarType::UChar)))
            .map(|(name, kind)| (name, PropertyType::Scalar(kind))),
    );
    let face = element(
        "face",
        mesh.triangles.len(),
        [(
            "vertex_indices",
            PropertyType::List(ScalarType::UChar, ScalarType::Int),
        )],
    );
    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header
        .comments
        .push(concat!("made by sos ", env!("CARGO_PKG_VERSION")).to_owned());
    header
        .comments
        .push("colours are sRGB, coordinates those of the camera poses".to_owned());
    header.elements.add(vertex.clone());
    header.elements.add(face.clone());

    Writer::<Vertex>::new().write_header(out, &header)?;
    let writer = Writer::<Vertex>::new();
    for ((position, normal), colour) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colours)
    {
        let element = Vertex {
            position: *position,
            normal: *normal,
            colour: *colour,
        };
        writer.write_little_endian_element(out, &element, &vertex)?;
    }
    let writer = Writer::<Face>::new();
    for corners in &mesh.triangles {
        writer.write_little_endian_element(out, &Face(corners.map(|i| i as i32)), &face)?;
    }
    Ok(())
}

fn element<'a>(
    name: &str,
    count: usize,
    properties: impl IntoIterator<Item = (&'a str, PropertyType)>,
) -> ElementDef {
    let mut element = ElementDef::new(name.to_owned());
    element.count = count;
    for (name, kind) in properties {
        element
            .properties
            .add(PropertyDef::new(name.to_owned(), kind));
    }
    element
}

fn needs_double(positions: &[[f64; 3]]) -> bool {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for position in positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    let extent = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max);
    let farthest = (0..3)
        .map(|i| high[i].abs().max(low[i].abs()))
        .fold(0.0, f64::max);
    farthest > FLOAT_IS_ENOUGH * extent
}

struct Vertex {
    position: [f64; 3],
    normal: [f32; 3],
    colour: [u8; 3],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self {
            position: [0.0; 3],
            normal: [0.0; 3],
            colour: [0; 3],
        }
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == name)?;
        Some(self.position[axis])
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        if let Some(axis) = ["nx", "ny", "nz"].iter().position(|axis| *axis == name) {
            return Some(self.normal[axis]);
        }
        self.get_double(name).map(|value| value as f32)
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        let channel = ["red", "green", "blue"]
            .iter()
            .position(|channel| *channel == name)?;
        Some(self.colour[channel])
    }
}

struct Face([i32; 3]);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self([0; 3])
    }

    fn get_list_int(&self, _name: &str) -> Option<&[i32]> {
        Some(&self.0)
    }
}
