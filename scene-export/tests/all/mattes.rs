//! Mattes in 8 bits, and premultiplied cut-outs.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha, key, object_colour};
use scene_export::Target;

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
    let bytes = std::fs::read(out.join("000.png")).unwrap();
    let says = |text: &[u8]| bytes.windows(text.len()).any(|window| window == text);
    assert!(says(b"premultiplied alpha") && says(b"sRGB"));
}
