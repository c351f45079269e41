//! The mesh as binary glTF 2.0 (ISO/IEC 12113).
//!
//! * `POSITION` with exact `min` and `max`, `NORMAL` of unit length, both float.
//! * `COLOR_0` is linear light, as the standard has it; 16 bits, since 8 would show bands in the dark.
//!   With a fourth component, so that every vertex begins at a multiple of four bytes.
//! * The material is `KHR_materials_unlit`: the colours are photographed and hold their light already.
//! * Coordinates are those of the camera poses. Where they are far from the origin, `f32` would round
//!   them: the node is moved by whole units then, and the vertices back.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::mesh::Mesh;
use glam::{DVec3, Vec3};
use gltf::binary::{Glb, Header};
use gltf::json;
use io_colmap::linear_from_srgb;
use json::accessor::{ComponentType, GenericComponentType, Type};
use json::buffer::Target;
use json::mesh::Semantic;
use json::validation::{Checked, USize64};
use json::{Accessor, Buffer, Index, Material, Node, Root, Scene, Value};
use std::borrow::Cow;
use std::io::{self, Write as _};

/// As in `mesh.ply`: coordinates this many times larger than the mesh's extent lose too much as `f32`.
const FLOAT_IS_ENOUGH: f64 = 1000.0;

pub(crate) fn write(mesh: &Mesh, draft: &Draft) -> Result<(), ExportError> {
    let (root, bin) = build(mesh);
    draft.write("mesh.glb", |out| {
        let glb = Glb {
            header: Header {
                magic: *b"glTF",
                version: 2,
                // The writer replaces it with the length after padding.
                length: 0,
            },
            json: Cow::Owned(root.to_vec().map_err(io::Error::other)?),
            bin: Some(Cow::Owned(bin)),
        };
        // A container of more than 4 GiB is refused in there.
        let bytes = glb.to_vec().map_err(io::Error::other)?;
        out.write_all(&bytes)
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

/// Zero, or the mesh's middle in whole units where `f32` cannot hold the coordinates themselves.
fn shift(mesh: &Mesh) -> DVec3 {
    let (low, high) = mesh.bounds();
    let extent = (high - low).max_element();
    let farthest = low.abs().max(high.abs()).max_element();
    if farthest > FLOAT_IS_ENOUGH * extent {
        // Whole units up to 16 million are exact as f32.
        ((low + high) / 2.0).round()
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
