//! Mattes in 8 bits, and premultiplied cut-outs.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha, key, object_colour};
use scene_export::Target;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

#[test]
fn mattes_are_rounded_to_8_bits() {
    let rig = Rig::new();
    let (out, written) = rig.files(Target::Alpha8);
    assert_eq!(written.count, PHOTOS.len());
    for (photo, name) in PHOTOS.iter().enumerate() {
        let found = image::open(out.join(format!("{}.png", key(name)))).unwrap();
        let found = found.as_luma8().expect("8-bit grey");
        assert_eq!(found.dimensions(), (WIDTH, HEIGHT));
        for (x, y, pixel) in found.enumerate_pixels() {
            let exact = f64::from(alpha(photo, x, y)) / 257.0;
            assert_eq!(f64::from(pixel[0]), exact.round());
        }
    }
    // A measurement claims no colour space.
    assert_eq!(header(&out.join("000.png")).srgb, None);
}

#[test]
fn premultiplied_colours_never_exceed_alpha() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Premultiplied);
    for (photo, name) in PHOTOS.iter().enumerate() {
        let found = image::open(out.join(format!("{}.png", key(name)))).unwrap();
        let found = found.as_rgba8().expect("8-bit RGBA");
        for (x, y, pixel) in found.enumerate_pixels() {
            let a = f64::from(alpha(photo, x, y)) / 65535.0;
            for c in 0..3 {
                let exact = f64::from(object_colour(x, y)[c]) * a;
                assert!((f64::from(pixel[c]) - exact).abs() <= 0.51);
                assert!(pixel[c] <= pixel[3]);
            }
        }
    }
    let info = header(&out.join("000.png"));
    assert!(info.srgb.is_some(), "the file says sRGB");
    let text = &info.uncompressed_latin1_text;
    assert!(
        text.iter()
            .any(|text| text.keyword == "Description"
                && text.text.starts_with("premultiplied alpha")),
        "{text:?}"
    );
}

/// What a PNG file says of itself.
fn header(path: &Path) -> png::Info<'static> {
    let file = BufReader::new(File::open(path).unwrap());
    let reader = png::Decoder::new(file).read_info().unwrap();
    reader.info().clone()
}
