//! The six pictures of one view.

use super::ExportError;
use super::picture::{Meaning, Picture, byte, word};
use crate::run_folder::{RunFolder, view_file};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, Text,
    WritableImage as _,
};
use image::GrayImage;
use png::{BitDepth, ColorType};
use rayon::prelude::*;
use std::collections::HashMap;
use std::io::{self, BufWriter, Cursor, Write as _};
use std::path::{Path, PathBuf};

// What the files say about themselves.
const ALPHA: &str = "coverage by the object, linear";
const FOREGROUND: &str = "straight (not premultiplied) alpha; colours are the object's own, without \
                          the background's share";
const BACKGROUND: &str = "the scene without the object";
const SEEN: &str = "number of views that saw what the background picture shows";
const NORMAL: &str = "unit normal in the world frame, (n + 1) / 2; black: no surface";
const FOUND_MASK: &str = "rough mask found without help; white is the object";
const UNCERTAINTY: &str = "how uncertain the matte is, linear; 0: sure, 255: not at all";
const DEPTH: &str = "Z: depth along the optical axis in scene units; 0: nothing there";

/// The final render of one view. All vectors have `width * height` entries, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewRender {
    /// The photo's file name, perhaps with sub-folders.
    pub name: String,
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Coverage by the object, 0..1.
    pub alpha: Vec<f32>,
    /// The object's own colour, sRGB 0..1: straight, without the background's share.
    pub foreground: Vec<[f32; 3]>,
    /// The scene without the object, sRGB 0..1.
    pub background: Vec<[f32; 3]>,
    /// Number of views that saw what the plate shows there.
    pub seen: Vec<u8>,
    /// Unit normals in the world frame; zero where there is no surface.
    pub normal: Vec<[f32; 3]>,
    /// Along the optical axis in scene units; 0 where nothing is.
    pub depth: Vec<f32>,
}

/// Writes a view's matte, cut-out, plate, seen map, normals and depth.
///
/// # Errors
/// [`ExportError::Run`] naming the file that could not be written.
///
/// # Panics
/// If a vector's length does not fit the size.
pub fn write_view(run: &RunFolder, view: &ViewRender) -> Result<(), ExportError> {
    let pixels = view.width as usize * view.height as usize;
    for (what, len) in [
        ("alpha", view.alpha.len()),
        ("foreground", view.foreground.len()),
        ("background", view.background.len()),
        ("seen", view.seen.len()),
        ("normal", view.normal.len()),
        ("depth", view.depth.len()),
    ] {
        assert_eq!(
            len, pixels,
            "write_view: argument {what} does not have {} x {} entries",
            view.width, view.height
        );
    }
    let alpha: Vec<u8> = view
        .alpha
        .iter()
        .flat_map(|a| word(*a).to_be_bytes())
        .collect();
    let cut_out: Vec<u8> = view
        .foreground
        .iter()
        .zip(&view.alpha)
        .flat_map(|(colour, alpha)| [colour[0], colour[1], colour[2], *alpha].map(byte))
        .collect();
    let plate: Vec<u8> = view.background.iter().flatten().map(|c| byte(*c)).collect();
    let normal: Vec<u8> = view.normal.iter().flat_map(encode_normal).collect();

    let picture = |kind, depth, meaning, remark, bytes| Picture {
        width: view.width,
        height: view.height,
        kind,
        depth,
        meaning,
        remark,
        bytes,
    };
    use BitDepth::{Eight, Sixteen};
    use ColorType::{Grayscale, Rgb, Rgba};
    use Meaning::{Colour, Data};
    let pictures = [
        (
            run.alpha_dir(),
            picture(Grayscale, Sixteen, Data, ALPHA, &alpha),
        ),
        (
            run.foreground_dir(),
            picture(Rgba, Eight, Colour, FOREGROUND, &cut_out),
        ),
        (
            run.background_dir(),
            picture(Rgb, Eight, Colour, BACKGROUND, &plate),
        ),
        (
            run.background_seen_dir(),
            picture(Grayscale, Eight, Data, SEEN, &view.seen),
        ),
        (run.normal_dir(), picture(Rgb, Eight, Data, NORMAL, &normal)),
    ];
    let depth = view_file(&run.depth_dir(), &view.name, "exr");
    let (pictures, depth) = rayon::join(
        || {
            pictures.par_iter().try_for_each(|(folder, picture)| {
                picture.write(run, &view_file(folder, &view.name, "png"))
            })
        },
        || run.write(&depth, |out| write_depth(out, view)),
    );
    pictures?;
    Ok(depth?)
}

/// Writes a rough mask that the run found by itself.
///
/// # Errors
/// [`ExportError::Run`] naming the file that could not be written.
pub fn write_found_mask(run: &RunFolder, name: &str, mask: &GrayImage) -> Result<(), ExportError> {
    write_grey(run, &run.found_masks_dir(), name, mask, FOUND_MASK)
}

/// Writes where a view's matte should not be relied on.
///
/// # Errors
/// [`ExportError::Run`] naming the file that could not be written.
pub fn write_uncertainty(run: &RunFolder, name: &str, grey: &GrayImage) -> Result<(), ExportError> {
    write_grey(run, &run.uncertainty_dir(), name, grey, UNCERTAINTY)
}

fn write_grey(
    run: &RunFolder,
    folder: &Path,
    name: &str,
    grey: &GrayImage,
    remark: &str,
) -> Result<(), ExportError> {
    Picture {
        width: grey.width(),
        height: grey.height(),
        kind: ColorType::Grayscale,
        depth: BitDepth::Eight,
        meaning: Meaning::Data,
        remark,
        bytes: grey.as_raw(),
    }
    .write(run, &view_file(folder, name, "png"))
}

/// Checks that no two photos of the scene in `folder` would write to the same files.
///
/// # Errors
/// [`ExportError::SameName`] for the first two that would.
pub fn check_names<'a>(
    folder: &Path,
    names: impl IntoIterator<Item = &'a str>,
) -> Result<(), ExportError> {
    let mut taken: HashMap<PathBuf, &str> = HashMap::new();
    for name in names {
        if let Some(first) = taken.insert(view_file(Path::new(""), name, "png"), name) {
            return Err(ExportError::SameName {
                folder: folder.to_owned(),
                first: first.to_owned(),
                second: name.to_owned(),
            });
        }
    }
    Ok(())
}

fn encode_normal(normal: &[f32; 3]) -> [u8; 3] {
    if *normal == [0.0; 3] {
        [0; 3]
    } else {
        normal.map(|n| byte(0.5 * (n + 1.0)))
    }
}

fn write_depth(out: &mut BufWriter<std::fs::File>, view: &ViewRender) -> io::Result<()> {
    let channel = AnyChannel::new("Z", FlatSamples::F32(view.depth.clone()));
    let mut attributes = LayerAttributes::named("depth");
    attributes.comments = Some(Text::from(DEPTH));
    attributes.software_name = Some(Text::from(concat!("sos ", env!("CARGO_PKG_VERSION"))));
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = [channel].into_iter().collect();
    let layer = Layer::new(
        (view.width as usize, view.height as usize),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    // In memory first: the encoder seeks, and drops errors of the last flush.
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| io::Error::other(e.to_string()))?;
    out.write_all(bytes.get_ref())
}
