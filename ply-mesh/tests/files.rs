//! Files of all encodings, and damaged ones.
#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec3};
use ply_mesh::Mesh;
use std::fs;

const ASCII: &str = "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty double x\nproperty float y\n\
property float z\nproperty uchar red\nproperty list uchar int views\nelement edge 1\nproperty int v\nelement face 1\nproperty uchar flags\n\
property list uchar uint vertex_index\nend_header\n0 0 0 9 0\n1 0 0 9 1 5\n1 1 0 9 0\n0 1 0 9 0\n3\n7 4 0 1 2 3\n";

/// A unit square of two triangles at `z = 0`.
fn square() -> Mesh {
    Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
        normals: vec![Vec3::ZERO; 4],
        colours: vec![[9, 255, 255]; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn written(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    mesh.write(&mut bytes, &["a test"]).unwrap();
    bytes
}

fn read(bytes: impl AsRef<[u8]>) -> Result<Mesh, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    fs::write(&path, bytes).unwrap();
    Mesh::read(&path).map_err(|error| error.to_string())
}

#[test]
fn ascii_polygons_become_fans() {
    assert_eq!(read(ASCII).unwrap(), square());
    let dots = ASCII.replace("4 0 1 2 3", "1 0");
    assert!(read(dots).unwrap().triangles.is_empty());
}

#[test]
fn binary_files_of_either_order_are_read() {
    for (order, word) in [
        ("little", f32::to_le_bytes as fn(f32) -> [u8; 4]),
        ("big", f32::to_be_bytes),
    ] {
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
property float z\nproperty uchar red\nelement face 1\nproperty list uchar uchar vertex_indices\nend_header\n"
        )
        .into_bytes();
        for position in square().positions {
            let words = position.to_array().map(|c| word(c as f32));
            bytes.extend(words.concat());
            bytes.push(9);
        }
        bytes.extend([4, 0, 1, 2, 3]);
        assert_eq!(read(&bytes).unwrap(), square(), "{order}");
        assert!(read(&bytes[..bytes.len() - 1]).is_err(), "{order}, cut off");
    }
}

#[test]
fn what_is_written_reads_back() {
    let mesh = Mesh {
        normals: vec![Vec3::Z; 4],
        ..square()
    };
    let bytes = written(&mesh);
    assert_eq!(read(&bytes).unwrap(), mesh);
    let end = bytes.windows(11).position(|w| w == b"end_header\n");
    let (header, payload) = bytes.split_at(end.unwrap() + 11);
    let header = String::from_utf8(header.to_vec()).unwrap();
    for line in [
        "format binary_little_endian 1.0",
        "comment a test",
        "property float x",
        "property float nx",
        "property uchar red",
        "property list uchar int vertex_indices",
    ] {
        assert!(header.contains(&format!("{line}\n")), "{header}");
    }
    // 6 floats and 3 bytes a vertex; a count and 3 indices a face.
    assert_eq!(payload.len(), 4 * 27 + 2 * 13);
    assert_eq!(payload[24..27], [9, 255, 255]);
    assert_eq!(read(written(&Mesh::default())).unwrap(), Mesh::default());
}

#[test]
fn a_mesh_far_from_the_origin_keeps_its_shape() {
    let far = DVec3::X * 4.5e6;
    let mut mesh = square().completed();
    mesh.positions.iter_mut().for_each(|p| *p = far + 0.01 * *p);
    assert_eq!(read(written(&mesh)).unwrap().positions, mesh.positions);
}

#[test]
fn normals_that_are_no_numbers_are_none() {
    let text = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\nproperty uchar y\n\
property uchar z\nproperty float nx\nproperty float ny\nproperty float nz\nend_header\n";
    let normal = [f32::NAN, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let bytes = [text.as_bytes(), &[1, 2, 3], &normal].concat();
    let mesh = read(bytes).unwrap();
    assert_eq!(mesh.positions, [DVec3::new(1.0, 2.0, 3.0)]);
    assert_eq!(mesh.normals, [Vec3::ZERO]);
}

#[test]
fn damaged_files_are_told_in_one_line() {
    for (text, clue) in [
        (
            ASCII.replace("0 1 2 3\n", "0 1 2 9\n"),
            "face 0 names vertex 9 of 4",
        ),
        (ASCII.replace("0 1 2 3\n", "0 1 -2 3\n"), "mesh.ply"),
        (
            ASCII.replace("vertex 4\n", "vertex 4000000000\n"),
            "mesh.ply",
        ),
        (
            ASCII
                .replace("property float z\n", "")
                .replace(" 0 9 ", " 9 "),
            "vertex 0 has no finite",
        ),
        (ASCII.replace("1 1 0 9", "1 nan 0 9"), "mesh.ply"),
        // Takes no bytes, so that a parser would never come to the end of the file.
        (
            "ply\nformat binary_little_endian 1.0\nelement vertex 100000000000\nend_header\n"
                .into(),
            "100000000000 of the element \"vertex\", which has no properties",
        ),
        ("not a mesh".into(), "mesh.ply"),
        (String::new(), "mesh.ply"),
    ] {
        let sentence = read(&text).unwrap_err();
        assert!(sentence.contains(clue), "{sentence}");
        assert!(!sentence.contains('\n'), "{sentence}");
    }
    assert!(Mesh::read("absent.ply".as_ref()).is_err());
}
