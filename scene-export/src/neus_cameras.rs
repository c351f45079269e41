//! `cameras_sphere.npz` of NeuS and IDR: for view `i`, `world_mat_i = K [R t]` and `scale_mat_i`, which
//! takes the unit sphere to one around the object. Both are 4 x 4 and `f64`.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::pinhole;
use crate::run::Posed;
use glam::{DMat3, DMat4, DVec3};
use io_colmap::Scene;
use ply_mesh::Mesh;
use std::io::{self, Cursor, Write as _};
use zip::write::SimpleFileOptions;

/// The sphere is this much larger than the object.
const MARGIN: f64 = 1.1;

pub(crate) fn write(
    scene: &Scene,
    posed: &[Posed<'_>],
    mesh: &Mesh,
    draft: &Draft,
) -> Result<(), ExportError> {
    pinhole::check("NeuS", scene, posed)?;
    let (low, high) = mesh.bounds();
    let centre = (low + high) / 2.0;
    let farthest = mesh
        .positions
        .iter()
        .map(|p| p.distance_squared(centre))
        .fold(0.0, f64::max);
    let radius = MARGIN * farthest.sqrt();
    let scale = DMat4::from_translation(centre) * DMat4::from_scale(DVec3::splat(radius));
    draft.write("cameras_sphere.npz", |out| {
        let bytes = archive(posed, scale).map_err(io::Error::other)?;
        out.write_all(&bytes)
    })
}

fn archive(posed: &[Posed<'_>], scale: DMat4) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (i, posed) in posed.iter().enumerate() {
        for (name, matrix) in [("world_mat", world_mat(*posed)), ("scale_mat", scale)] {
            archive.start_file(format!("{name}_{i}.npy"), options)?;
            archive.write_all(&npy(matrix))?;
        }
    }
    Ok(archive.finish()?.into_inner())
}

/// From world points to pixels times depth.
fn world_mat(posed: Posed<'_>) -> DMat4 {
    let ((fx, fy), (cx, cy)) = (posed.camera.focal(), posed.camera.principal_point());
    // NeuS sends a pixel's ray through its whole number: the first one's centre is at 0, not at 0.5 as in COLMAP.
    let k = DMat3::from_cols(
        DVec3::new(fx, 0.0, 0.0),
        DVec3::new(0.0, fy, 0.0),
        DVec3::new(cx - 0.5, cy - 0.5, 1.0),
    );
    let pose = posed.view.camera_from_world;
    DMat4::from_mat3(k) * DMat4::from_rotation_translation(pose.rotation, pose.translation)
}

/// NumPy's file format, version 1.0: magic, version, length of a header that ends at a multiple of 64
/// bytes, the header as a Python literal, the numbers row by row.
fn npy(matrix: DMat4) -> Vec<u8> {
    let mut header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 4), }".to_owned();
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    // glam keeps columns.
    let rows = matrix.transpose().to_cols_array();
    bytes.extend(rows.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}
