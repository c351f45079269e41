//! The mesh as binary glTF 2.0 (ISO/IEC 12113).
//!
//! * `POSITION` with exact `min` and `max`, `NORMAL` of unit length, both float.
//! * `COLOR_0` is linear light, as the standard has it; 16 bits, since 8 would show bands in the dark.
//!   With a fourth component, so that every vertex begins at a multiple of four bytes.
//! * The material is `KHR_materials_unlit`: the colours are photographed and hold their light already.
//! * Coordinates are those of the camera poses. Where they are far from the origin, `f32` would round
//!   them: the node is moved to the mesh's middle then, as `f32` has it, and the vertices back by exactly that.

use crate::draft::Draft;
use crate::error::ExportError;
use glam::{DVec3, Vec3};
use gltf::binary::{Glb, Header};
use gltf::json;
use io_colmap::linear_from_srgb;
use json::accessor::{ComponentType, GenericComponentType, Type};
use json::buffer::Target;
use json::mesh::Semantic;
use json::validation::{Checked, USize64};
use json::{Accessor, Buffer, Index, Material, Node, Root, Scene, Value};
use ply_mesh::Mesh;
use std::borrow::Cow;
use std::io::{self, Write as _};

/// As in `mesh.ply`: coordinates this many times larger than the mesh's extent lose too much as `f32`.
const FLOAT_IS_ENOUGH: f64 = 1000.0;

/// The container states its length in 32 bits.
const MOST_BYTES: u64 = u32::MAX as u64;

pub(crate) fn write(mesh: &Mesh, draft: &Draft) -> Result<(), ExportError> {
    let (root, bin) = build(mesh);
    let place = draft.goal("mesh.glb");
    let failed = |error| ExportError::io("write", &place, io::Error::other(error));
    let json = root.to_vec().map_err(failed)?;
    let glb = container(json, bin, MOST_BYTES).map_err(|length| {
        let what = format!(
            "it would have {length} bytes, and a glTF container holds at most {MOST_BYTES}"
        );
        let remedy = "take --to obj, or have the run write a coarser mesh (export.mesh_resolution)";
        ExportError::bad(&place, what, remedy)
    })?;
    let bytes = glb.to_vec().map_err(io::Error::other);
    draft.write("mesh.glb", |out| out.write_all(&bytes?))
}

/// The file, unless its bytes are more than `most`: then the error is how many.
fn container(json: Vec<u8>, bin: Vec<u8>, most: u64) -> Result<Glb<'static>, u64> {
    // A header of twelve bytes, and two chunks with eight each that end at multiples of four.
    let chunk = |bytes: &[u8]| 8 + (bytes.len() as u64).next_multiple_of(4);
    let length = 12 + chunk(&json) + chunk(&bin);
    if length > most {
        return Err(length);
    }
    Ok(Glb {
        header: Header {
            magic: *b"glTF",
            version: 2,
            // The writer replaces it with the length after padding, of which it takes the lower 32 bits.
            length: 0,
        },
        json: Cow::Owned(json),
        bin: Some(Cow::Owned(bin)),
    })
}

/// The document, and what its one buffer holds.
fn build(mesh: &Mesh) -> (Root, Vec<u8>) {
    let shift = shift(mesh);
    let positions: Vec<Vec3> = mesh
        .positions
        .iter()
        .map(|p| (*p - shift).as_vec3())
        .collect();
    let low = positions.iter().fold(Vec3::INFINITY, |a, b| a.min(*b));
    let high = positions.iter().fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
    let word = |byte: u8| (linear_from_srgb(byte) * 65535.0).round() as u16;

    let mut parts = Parts::default();
    let floats = |vectors: &[Vec3]| -> Vec<u8> {
        let numbers = vectors.iter().flat_map(|v| v.to_array());
        numbers.flat_map(f32::to_le_bytes).collect()
    };
    let vertices = positions.len();
    let bounds = Some((vector(low), vector(high)));
    let position = parts.add(
        Kind::Vertices(ComponentType::F32, Type::Vec3),
        vertices,
        floats(&positions),
        bounds,
    );
    let normal = parts.add(
        Kind::Vertices(ComponentType::F32, Type::Vec3),
        vertices,
        floats(&mesh.normals),
        None,
    );
    let colours = mesh
        .colours
        .iter()
        .flat_map(|[r, g, b]| [word(*r), word(*g), word(*b), u16::MAX])
        .flat_map(u16::to_le_bytes)
        .collect();
    let colour = parts.add(
        Kind::Vertices(ComponentType::U16, Type::Vec4),
        vertices,
        colours,
        None,
    );
    let corners = mesh.triangles.iter().flatten();
    let indices = parts.add(
        Kind::Indices,
        3 * mesh.triangles.len(),
        corners.flat_map(|i| i.to_le_bytes()).collect(),
        None,
    );

    let Parts { mut root, bin } = parts;
    root.asset.generator = Some(concat!("sos ", env!("CARGO_PKG_VERSION")).to_owned());
    root.extensions_used = vec!["KHR_materials_unlit".to_owned()];
    root.buffers[0].byte_length = USize64::from(bin.len());
    let material = root.push(unlit());
    let attributes = [
        (Semantic::Positions, position),
        (Semantic::Normals, normal),
        (Semantic::Colors(0), colour),
    ];
    let surface = root.push(json::Mesh {
        extensions: None,
        extras: json::Extras::default(),
        name: Some("object".to_owned()),
        primitives: vec![json::mesh::Primitive {
            attributes: attributes
                .into_iter()
                .map(|(semantic, accessor)| (Checked::Valid(semantic), accessor))
                .collect(),
            extensions: None,
            extras: json::Extras::default(),
            indices: Some(indices),
            material: Some(material),
            mode: Checked::Valid(json::mesh::Mode::Triangles),
            targets: None,
        }],
        weights: None,
    });
    let node = root.push(Node {
        mesh: Some(surface),
        name: Some("object".to_owned()),
        translation: (shift != DVec3::ZERO).then(|| shift.as_vec3().to_array()),
        ..Node::default()
    });
    let scene = root.push(Scene {
        extensions: None,
        extras: json::Extras::default(),
        name: None,
        nodes: vec![node],
    });
    root.scene = Some(scene);
    (root, bin)
}

/// Zero, or the mesh's middle where `f32` cannot hold the coordinates themselves; exact as `f32`.
fn shift(mesh: &Mesh) -> DVec3 {
    let (low, high) = mesh.bounds();
    let extent = (high - low).max_element();
    let farthest = low.abs().max(high.abs()).max_element();
    if farthest > FLOAT_IS_ENOUGH * extent {
        ((low + high) / 2.0).as_vec3().as_dvec3()
    } else {
        DVec3::ZERO
    }
}

fn vector(v: Vec3) -> Value {
    Value::from(v.to_array().to_vec())
}

fn unlit() -> Material {
    Material {
        name: Some("photographed".to_owned()),
        // For viewers without the extension: a matt surface.
        pbr_metallic_roughness: json::material::PbrMetallicRoughness {
            metallic_factor: json::material::StrengthFactor(0.0),
            roughness_factor: json::material::StrengthFactor(1.0),
            ..Default::default()
        },
        extensions: Some(json::extensions::material::Material {
            unlit: Some(json::extensions::material::Unlit {}),
        }),
        ..Material::default()
    }
}

/// What a part of the buffer holds.
#[derive(Clone, Copy)]
enum Kind {
    Vertices(ComponentType, Type),
    /// `u32`.
    Indices,
}

/// A document in the making, with its buffer.
struct Parts {
    root: Root,
    bin: Vec<u8>,
}

impl Default for Parts {
    fn default() -> Self {
        let mut root = Root::default();
        root.push(Buffer {
            byte_length: USize64(0),
            name: None,
            uri: None,
            extensions: None,
            extras: json::Extras::default(),
        });
        Self {
            root,
            bin: Vec::new(),
        }
    }
}

impl Parts {
    /// Appends `count` elements, whose bytes are a multiple of four, with a view and an accessor.
    fn add(
        &mut self,
        kind: Kind,
        count: usize,
        bytes: Vec<u8>,
        bounds: Option<(Value, Value)>,
    ) -> Index<Accessor> {
        let (component, shape, target) = match kind {
            Kind::Vertices(component, shape) => (component, shape, Target::ArrayBuffer),
            Kind::Indices => (ComponentType::U32, Type::Scalar, Target::ElementArrayBuffer),
        };
        let view = self.root.push(json::buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(self.bin.len())),
            byte_stride: None,
            name: None,
            target: Some(Checked::Valid(target)),
            extensions: None,
            extras: json::Extras::default(),
        });
        self.bin.extend(bytes);
        let (min, max) = bounds.unzip();
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Checked::Valid(GenericComponentType(component)),
            extensions: None,
            extras: json::Extras::default(),
            type_: Checked::Valid(shape),
            min,
            max,
            name: None,
            normalized: component == ComponentType::U16,
            sparse: None,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_the_container_cannot_hold_is_not_written() {
        for (json, bin) in [(8, 12), (7, 9)] {
            let glb = |most| container(vec![b' '; json], vec![0; bin], most);
            // Header, two chunks' headers, and the chunks themselves.
            let length = 12 + 8 + 8 + 8 + 12;
            assert_eq!(glb(length).unwrap().to_vec().unwrap().len() as u64, length);
            assert_eq!(glb(length - 1).err(), Some(length));
        }
    }
}
