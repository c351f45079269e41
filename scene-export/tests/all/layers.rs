//! The EXR layers hold what the run's pictures hold, in linear light.

use crate::rig::{
    HEIGHT, PHOTOS, Rig, WIDTH, alpha, depth, key, listing, object_colour, plate_colour,
};
use exr::meta::attribute::AttributeValue;
use exr::prelude::{FlatSamples, ReadChannels as _, ReadLayers as _, Text, Vec2, read};
use scene_export::Target;
use std::collections::BTreeMap;
use std::path::Path;

fn linear(byte: u8) -> f32 {
    let v = f32::from(byte) / 255.0;
    if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

/// Channels by name, as numbers, with the type.
fn channels(path: &Path) -> BTreeMap<String, (&'static str, Vec<f32>)> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap();
    let white = image.attributes.chromaticities.unwrap().white;
    assert_eq!(white, Vec2(0.3127, 0.3290));
    let attributes = image.layer_data.attributes;
    assert!(
        attributes
            .comments
            .unwrap()
            .to_string()
            .contains("premultiplied by A")
    );
    assert_eq!(
        attributes.other.get(&Text::from("sos:alpha")),
        Some(&AttributeValue::Text(Text::from("premultiplied")))
    );
    assert_eq!(image.layer_data.size, Vec2(WIDTH as usize, HEIGHT as usize));
    let list = image.layer_data.channel_data.list;
    list.into_iter()
        .map(|channel| {
            let kind = match channel.sample_data {
                FlatSamples::F16(_) => "half",
                FlatSamples::F32(_) => "float",
                FlatSamples::U32(_) => "uint",
            };
            let values = channel.sample_data.values_as_f32().collect();
            (channel.name.to_string(), (kind, values))
        })
        .collect()
}

#[test]
fn every_view_has_its_layers() {
    let rig = Rig::new();
    let (out, written) = rig.files(Target::Exr);
    assert_eq!(written.count, PHOTOS.len());
    assert_eq!(
        listing(&out),
        [
            "000.exr",
            "001.exr",
            "002.exr",
            "cam2/b.c.exr",
            "export.txt"
        ]
    );
    for (photo, name) in PHOTOS.iter().enumerate() {
        let channels = channels(&out.join(format!("{}.exr", key(name))));
        let kinds: Vec<(&str, &str)> = channels
            .iter()
            .map(|(name, (kind, _))| (name.as_str(), *kind))
            .collect();
        assert_eq!(
            kinds,
            [
                ("A", "float"),
                ("B", "half"),
                ("G", "half"),
                ("N.X", "half"),
                ("N.Y", "half"),
                ("N.Z", "half"),
                ("R", "half"),
                ("Z", "float"),
                ("background.B", "half"),
                ("background.G", "half"),
                ("background.R", "half"),
                ("id", "uint"),
            ]
        );
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let at = |name: &str| channels[name].1[(y * WIDTH + x) as usize];
                let a = f32::from(alpha(photo, x, y)) / 65535.0;
                assert_eq!(at("A"), a, "the matte's 16 bits survive");
                assert_eq!(at("id"), if a >= 0.5 { 1.0 } else { 0.0 });
                assert_eq!(at("Z"), depth(photo, x, y));
                // A half has 11 significant bits.
                let close = |found: f32, wanted: f32| {
                    assert!(
                        (found - wanted).abs() <= wanted / 2000.0 + 1e-6,
                        "{found} {wanted}"
                    );
                };
                for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
                    close(at(letter), linear(object_colour(x, y)[c]) * a);
                    close(
                        at(&format!("background.{letter}")),
                        linear(plate_colour(x)[c]),
                    );
                }
                let n = [at("N.X"), at("N.Y"), at("N.Z")];
                if depth(photo, x, y) > 0.0 {
                    assert!((n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 2e-3);
                    assert!(n[2] < -0.99);
                } else {
                    assert_eq!(n, [0.0; 3]);
                }
            }
        }
    }
}
