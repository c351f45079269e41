//! One multi-layer OpenEXR file per view.
//!
//! | channels | type | what |
//! |---|---|---|
//! | `R`, `G`, `B` | half | the object's own colour, linear light, Rec. 709 primaries, times `A` |
//! | `A` | float | coverage by the object: half would round what the 16-bit matte knows |
//! | `Z` | float | depth along the optical axis in scene units, not premultiplied; 0: nothing there |
//! | `N.X`, `N.Y`, `N.Z` | half | unit normal in the world frame, not premultiplied; 0: no surface |
//! | `background.R`, `.G`, `.B` | half | the scene without the object, linear light |
//! | `id` | uint | 1 where the object covers at least half of the pixel, else 0 |
//!
//! One part, lossless ZIP. The same is said in the file's `comments` and in attributes `sos:…`.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::picture::HALF;
use crate::run::Run;
use exr::meta::attribute::{AttributeValue, Chromaticities};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    ReadChannels as _, ReadLayers as _, SmallVec, Text, Vec2, WritableImage as _, f16, read,
};
use io_colmap::linear_from_srgb;
use rayon::prelude::*;
use std::io::{self, Cursor, Write as _};
use std::path::Path;

const COMMENTS: &str = "R G B: the object's own colour in linear light, Rec. 709 primaries, \
premultiplied by A. A: coverage by the object. Z: depth along the optical axis in scene units, not \
premultiplied, 0 where nothing is. N.X N.Y N.Z: unit normal in the world frame, not premultiplied, 0 \
where no surface is. background.R G B: the scene without the object in linear light. id: 1 where A is \
at least 0.5.";

/// Attributes of the file for programs, beside the comments for people.
const ATTRIBUTES: [(&str, &str); 3] = [
    ("sos:alpha", "premultiplied"),
    ("sos:colourSpace", "linear Rec. 709 (sRGB primaries)"),
    ("sos:normalFrame", "world"),
];

/// CIE xy of Rec. 709, which are sRGB's, with D65.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Writes `NAME.exr` for every view; returns how many.
pub(crate) fn write(run: &Run, draft: &Draft) -> Result<usize, ExportError> {
    let linear = std::array::from_fn(|byte| linear_from_srgb(byte as u8) as f32);
    run.keys
        .par_iter()
        .try_for_each(|key| write_view(run, key, &linear, draft))?;
    Ok(run.keys.len())
}

fn write_view(run: &Run, key: &str, linear: &[f32; 256], draft: &Draft) -> Result<(), ExportError> {
    let cutout = run.cutout(key)?;
    let size = (cutout.alpha.width, cutout.alpha.height);
    let plate = run.rgb("background", key, size)?;
    let normals = run.rgb("normal", key, size)?;
    let depth = read_depth(run, key, size)?;

    let alpha: Vec<f32> = cutout
        .alpha
        .values
        .iter()
        .map(|value| f32::from(*value) / 65535.0)
        .collect();
    let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    let mut half = |name: &str, values: Vec<f16>| {
        channels.push(AnyChannel::new(name, FlatSamples::F16(values)));
    };
    for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
        let light = |colour: &[u8; 3]| linear[usize::from(colour[c])];
        let object = cutout.colours.iter().zip(&alpha);
        half(
            letter,
            object
                .map(|(colour, alpha)| f16::from_f32(light(colour) * alpha))
                .collect(),
        );
        half(
            &format!("background.{letter}"),
            plate.iter().map(|p| f16::from_f32(light(p))).collect(),
        );
    }
    let directions: Vec<[f32; 3]> = normals.iter().map(direction).collect();
    for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
        let values = directions.iter().map(|n| f16::from_f32(n[axis])).collect();
        half(&format!("N.{letter}"), values);
    }
    let object = |value: &u16| u32::from(*value >= HALF);
    let ids = cutout.alpha.values.iter().map(object).collect();
    channels.push(AnyChannel::new("id", FlatSamples::U32(ids)));
    channels.push(AnyChannel::new("A", FlatSamples::F32(alpha)));
    channels.push(AnyChannel::new("Z", FlatSamples::F32(depth)));

    let mut attributes = LayerAttributes {
        comments: Some(Text::from(COMMENTS)),
        software_name: Some(Text::from(concat!("sos ", env!("CARGO_PKG_VERSION")))),
        ..LayerAttributes::default()
    };
    for (name, value) in ATTRIBUTES {
        let value = AttributeValue::Text(Text::from(value));
        attributes.other.insert(Text::from(name), value);
    }
    let mut image = Image::from_layer(Layer::new(
        (size.0 as usize, size.1 as usize),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    ));
    image.attributes.chromaticities = Some(REC_709);
    draft.write(&format!("{key}.exr"), |out| {
        // In memory first: the encoder seeks, and drops errors of the last flush.
        let mut bytes = Cursor::new(Vec::new());
        image
            .write()
            .non_parallel()
            .to_buffered(&mut bytes)
            .map_err(|e| io::Error::other(e.to_string()))?;
        out.write_all(bytes.get_ref())
    })
}

/// The unit vector of a pixel that holds (n + 1) / 2, in which black means none.
fn direction(pixel: &[u8; 3]) -> [f32; 3] {
    if *pixel == [0; 3] {
        return [0.0; 3];
    }
    let n = glam::Vec3::from(pixel.map(|byte| f32::from(byte) / 127.5 - 1.0));
    n.normalize_or_zero().to_array()
}

/// The channel `Z` of the view's depth file.
fn read_depth(run: &Run, key: &str, size: (u32, u32)) -> Result<Vec<f32>, ExportError> {
    let path = run.picture_path("depth", key, "exr");
    let bytes = std::fs::read(&path).map_err(|e| ExportError::io("read", &path, e))?;
    let unreadable = |what: String| run.damaged(&path, what);
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| unreadable(format!("the depth cannot be read ({e})")))?;
    let layer = image.layer_data;
    let found = (layer.size.width() as u32, layer.size.height() as u32);
    run.check_size(Path::new(&path), found, size)?;
    let channels = layer.channel_data.list;
    match channels.into_iter().find(|c| c.name.eq("Z")) {
        Some(channel) => Ok(channel.sample_data.values_as_f32().collect()),
        None => Err(unreadable("there is no channel Z in it".to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_unit_length_or_none() {
        assert_eq!(direction(&[0, 0, 0]), [0.0; 3]);
        let [x, y, z] = direction(&[255, 128, 127]);
        assert!((x * x + y * y + z * z - 1.0).abs() < 1e-6);
        assert!(x > 0.99);
    }
}
