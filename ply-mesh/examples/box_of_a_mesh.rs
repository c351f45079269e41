//! Says how large a mesh is, and writes it again as a small binary file with normals.
//!
//! `cargo run --release -p ply-mesh --example box_of_a_mesh FROM.ply [TO.ply]`

use std::env;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::PathBuf;

use ply_mesh::Mesh;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut files = env::args_os().skip(1).map(PathBuf::from);
    let from = files
        .next()
        .ok_or("give a file: box_of_a_mesh FROM.ply [TO.ply]")?;
    let mesh = Mesh::read(&from)?.completed();
    let (low, high) = mesh.bounds();
    println!(
        "{} vertices and {} triangles from {low:.3} to {high:.3}",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    if let Some(to) = files.next() {
        let mut out = BufWriter::new(File::create(&to)?);
        mesh.write(&mut out, &[])?;
        out.flush()?;
    }
    Ok(())
}
