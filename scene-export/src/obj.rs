//! The mesh as Wavefront OBJ, with colours behind the coordinates: `v x y z r g b`.
//!
//! That extension is MeshLab's and Blender's among others; colours are sRGB in 0..1, as in the PLY
//! they come from. Readers that do not know it ignore what follows the coordinates.

use crate::draft::Draft;
use crate::error::ExportError;
use ply_mesh::Mesh;
use std::io::Write as _;

pub(crate) fn write(mesh: &Mesh, draft: &Draft) -> Result<(), ExportError> {
    draft.write("mesh.obj", |out| {
        writeln!(out, "# made by sos {}", env!("CARGO_PKG_VERSION"))?;
        writeln!(
            out,
            "# v x y z r g b: coordinates are those of the camera poses, colours are sRGB"
        )?;
        writeln!(out, "o object")?;
        for (p, colour) in mesh.positions.iter().zip(&mesh.colours) {
            let [r, g, b] = colour.map(|byte| f32::from(byte) / 255.0);
            // As short as reads back to the same numbers, of which most were f32 in the run.
            let single = p.as_vec3();
            if single.as_dvec3() == *p {
                write!(out, "v {} {} {}", single.x, single.y, single.z)?;
            } else {
                write!(out, "v {} {} {}", p.x, p.y, p.z)?;
            }
            writeln!(out, " {r:.4} {g:.4} {b:.4}")?;
        }
        for n in &mesh.normals {
            writeln!(out, "vn {:.5} {:.5} {:.5}", n.x, n.y, n.z)?;
        }
        for corners in &mesh.triangles {
            // Counted from 1; vertex and normal have the same number.
            let [a, b, c] = corners.map(|i| u64::from(i) + 1);
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
        Ok(())
    })
}
