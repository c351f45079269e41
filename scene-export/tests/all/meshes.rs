//! Meshes read back as they were.

use crate::rig::{PLY, Rig, corners};
use glam::{DVec3, Vec3};
use gltf::mesh::util::ReadColors;
use gltf::{Gltf, Semantic};
use scene_export::Target;
use std::fs;
use std::path::Path;

#[test]
fn obj_has_colours_behind_coordinates() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Obj);
    let text = fs::read_to_string(out.join("mesh.obj")).unwrap();
    let lines = |start: &str| -> Vec<Vec<f64>> {
        let found = text.lines().filter_map(|line| line.strip_prefix(start));
        found
            .map(|rest| {
                rest.split_whitespace()
                    .map(|v| v.parse().unwrap())
                    .collect()
            })
            .collect()
    };
    let vertices = lines("v ");
    assert_eq!(vertices[0], [0.5, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert_eq!(vertices[3][3..], [0.502; 3]);
    for (vertex, corner) in vertices.iter().zip(corners()) {
        assert_eq!(DVec3::from_slice(&vertex[..3]), corner);
    }
    assert_eq!(lines("vn ")[5], [0.0, 0.0, -1.0]);
    let faces: Vec<&str> = text.lines().filter(|line| line.starts_with("f ")).collect();
    assert_eq!((vertices.len(), faces.len()), (6, 8));
    assert_eq!(faces[0], "f 1//1 3//3 5//5");
}

/// What the file's one primitive holds: positions, normals, colours, indices.
fn read_glb(path: &Path) -> (Vec<Vec3>, Vec<Vec3>, Vec<[u16; 4]>, Vec<u32>) {
    let file = Gltf::from_slice(&fs::read(path).unwrap()).unwrap();
    let bin = file.blob.clone().unwrap();
    let mesh = file.meshes().next().unwrap();
    let primitive = mesh.primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(&bin));
    let Some(ReadColors::RgbaU16(colours)) = reader.read_colors(0) else {
        panic!("colours are four 16-bit numbers");
    };
    (
        reader.read_positions().unwrap().map(Vec3::from).collect(),
        reader.read_normals().unwrap().map(Vec3::from).collect(),
        colours.collect(),
        reader.read_indices().unwrap().into_u32().collect(),
    )
}

#[test]
fn glb_keeps_the_rules_of_the_standard() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Glb);
    let path = out.join("mesh.glb");
    let bytes = fs::read(&path).unwrap();
    assert_eq!(&bytes[..4], b"glTF");
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((number(4), number(8)), (2, bytes.len()));
    assert!(number(12).is_multiple_of(4) && bytes.len().is_multiple_of(4));

    let file = Gltf::from_slice(&bytes).unwrap();
    let bin = file.blob.clone().unwrap();
    assert_eq!(file.buffers().next().unwrap().length(), bin.len());
    let mut end = 0;
    for view in file.views() {
        assert_eq!(
            (view.offset(), view.offset() % 4, view.length() % 4),
            (end, 0, 0)
        );
        end = view.offset() + view.length();
    }
    assert_eq!(end, bin.len());
    let mesh = file.meshes().next().unwrap();
    let primitive = mesh.primitives().next().unwrap();
    assert!(primitive.material().unlit());
    assert!(
        file.extensions_used()
            .any(|name| name == "KHR_materials_unlit")
    );

    let (positions, normals, colours, indices) = read_glb(&path);
    for (position, corner) in positions.iter().zip(corners()) {
        assert_eq!(position.as_dvec3(), corner);
    }
    assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
    // Linear light: 128 of 255 is 0.21586.
    assert_eq!(colours[0], [u16::MAX, 0, 0, u16::MAX]);
    assert_eq!(colours[3], [14146, 14146, 14146, u16::MAX]);
    assert_eq!((indices.len(), &indices[..3]), (24, &[0, 2, 4][..]));

    let accessor = primitive.get(&Semantic::Positions).unwrap();
    let bound = |value: Option<gltf::json::Value>| -> Vec<f64> {
        let list = value.unwrap();
        list.as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect()
    };
    assert_eq!(bound(accessor.min()), [-0.5; 3]);
    assert_eq!(bound(accessor.max()), [0.5; 3]);
}

/// The octahedron in double precision, smaller and elsewhere.
fn moved(scale: f64, to: DVec3) -> String {
    let text = PLY.replace("float x", "double x");
    let text = text.replace("float y", "double y");
    let text = text.replace("float z", "double z");
    let (head, body) = text.split_once("end_header\n").unwrap();
    let lines: Vec<String> = body
        .lines()
        .map(|line| {
            let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if words.len() == 9 {
                for axis in 0..3 {
                    let value: f64 = words[axis].parse().unwrap();
                    words[axis] = format!("{:.17}", scale * value + to[axis]);
                }
            }
            words.join(" ")
        })
        .collect();
    format!("{head}end_header\n{}\n", lines.join("\n"))
}

#[test]
fn glb_far_from_the_origin_is_not_rounded() {
    for (scale, far) in [
        (1.0, DVec3::new(500_000.25, 5_400_000.0, 100.0)),
        // Where f32 has no whole numbers any more.
        (1.0, DVec3::new(40_000_001.3, -70_000_003.0, 0.0)),
        // Less than a unit large and away, and still far for its size.
        (1e-4, DVec3::new(0.4, -0.3, 0.2)),
        (1e-4, DVec3::new(1000.3, 0.0, 0.0)),
    ] {
        let rig = Rig::new();
        fs::write(rig.run().join("mesh.ply"), moved(scale, far)).unwrap();
        let (out, _) = rig.files(Target::Glb);
        let (positions, ..) = read_glb(&out.join("mesh.glb"));
        let file = Gltf::open(out.join("mesh.glb")).unwrap();
        let (shift, ..) = file.nodes().next().unwrap().transform().decomposed();
        for (position, corner) in positions.iter().zip(corners()) {
            let found = position.as_dvec3() + Vec3::from(shift).as_dvec3();
            let off = (found - (scale * corner + far)).length();
            assert!(off < 1e-6 * scale, "{scale} {far}: {off}");
        }
    }
}

#[test]
fn polygons_are_cut_and_missing_normals_found() {
    let rig = Rig::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty \
               float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 \
               0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    fs::write(rig.run().join("mesh.ply"), ply).unwrap();
    let (out, _) = rig.files(Target::Glb);
    let (_, normals, colours, indices) = read_glb(&out.join("mesh.glb"));
    assert_eq!(indices, [0, 1, 2, 0, 2, 3]);
    assert_eq!(normals, [Vec3::Z; 4]);
    assert_eq!(colours, [[u16::MAX; 4]; 4]);
}
