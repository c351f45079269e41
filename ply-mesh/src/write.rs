//! Meshes as binary files.

use crate::Mesh;
use crate::vertex::{COLOUR, NORMAL, POSITION, Vertex};
use ply_rs_bw::ply::{
    Addable as _, ElementDef, Encoding, Header, PropertyAccess, PropertyDef, PropertyType,
    ScalarType,
};
use ply_rs_bw::writer::Writer;
use std::io::{self, Write};

/// Coordinates may be this many times larger than the mesh's extent before `float` is too coarse for
/// them: a step of it is then 1/8000 of the extent.
const FLOAT_IS_ENOUGH: f64 = 1000.0;

impl Mesh {
    /// Writes it binary little-endian, with normals and colours. Coordinates are `float`, or `double` where the mesh
    /// lies so far from the origin that `float` would round it visibly. Writes are small: buffer `out`.
    ///
    /// # Errors
    /// What `out` says.
    ///
    /// # Panics
    /// If normals or colours are not one per vertex, or a triangle names a vertex that does not exist.
    pub fn write(&self, out: &mut impl Write, comments: &[&str]) -> io::Result<()> {
        let vertices = self.positions.len();
        assert_eq!(
            self.normals.len(),
            vertices,
            "Mesh::write: normals are not one per vertex"
        );
        assert_eq!(
            self.colours.len(),
            vertices,
            "Mesh::write: colours are not one per vertex"
        );
        let mut corners = self.triangles.iter().flatten();
        assert!(
            corners.all(|i| (*i as usize) < vertices),
            "Mesh::write: a triangle names a vertex beyond the {vertices} there are"
        );
        encode(self, out, comments)
    }
}

fn encode(mesh: &Mesh, out: &mut impl Write, comments: &[&str]) -> io::Result<()> {
    let coordinate = if needs_double(mesh) {
        ScalarType::Double
    } else {
        ScalarType::Float
    };
    let vertex = element(
        "vertex",
        mesh.positions.len(),
        POSITION
            .map(|name| (name, coordinate.clone()))
            .into_iter()
            .chain(NORMAL.map(|name| (name, ScalarType::Float)))
            .chain(COLOUR.map(|name| (name, ScalarType::UChar)))
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
        .extend(comments.iter().map(|&text| text.to_owned()));
    header.elements.add(vertex.clone());
    header.elements.add(face.clone());

    let writer = Writer::<Vertex>::new();
    writer.write_header(out, &header)?;
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

fn needs_double(mesh: &Mesh) -> bool {
    let (low, high) = mesh.bounds();
    let farthest = low.abs().max(high.abs()).max_element();
    !mesh.positions.is_empty() && farthest > FLOAT_IS_ENOUGH * (high - low).max_element()
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
