//! Exports a finished run: `cargo run -p scene-export --example export RUN FORMAT OUT`, where FORMAT is
//! one of `exr obj glb coco colmap-scene alpha8 premultiplied video`.

use scene_export::{Options, Product, Target, export};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [run, format, out] = arguments.as_slice() else {
        eprintln!("usage: export RUN FORMAT OUT");
        return ExitCode::from(2);
    };
    match write(Path::new(run), format, Path::new(out)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn write(run: &Path, format: &str, out: &Path) -> Result<(), Box<dyn Error>> {
    let product = Product::Files(format.parse::<Target>()?);
    let written = export(run, product, out, &Options::default())?;
    for note in &written.notes {
        println!("{note}");
    }
    println!("{}", written.sentence(product));
    Ok(())
}
