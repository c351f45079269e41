//! Copies the files of a folder so that the copy is either whole or not there, in place of an older one.
//!
//! `cargo run --release -p draft-folder --example copy_whole FROM TO`

use std::env;
use std::fs;
use std::path::PathBuf;

use draft_folder::Draft;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folders: Vec<PathBuf> = env::args_os().skip(1).map(PathBuf::from).collect();
    let [from, to] = folders.as_slice() else {
        return Err("give two folders: copy_whole FROM TO".into());
    };
    let draft = Draft::beside(to)?;
    let mut copied = 0;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            fs::copy(entry.path(), draft.path().join(entry.file_name()))?;
            copied += 1;
        }
    }
    // Until here nobody has seen anything of it; an error would have left what was there before.
    draft.replace()?;
    println!("{copied} files in {}", to.display());
    Ok(())
}
