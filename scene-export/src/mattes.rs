//! The run's pictures in the forms that simpler tools take: 8-bit mattes, premultiplied cut-outs.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::picture::{Kind, Picture, byte};
use crate::run::Run;
use rayon::prelude::*;

/// Writes `NAME.png` for every view, 8-bit grey; returns how many.
pub(crate) fn write_alpha8(run: &Run, draft: &Draft) -> Result<usize, ExportError> {
    run.keys.par_iter().try_for_each(|key| {
        let matte = run.matte(key)?;
        let bytes: Vec<u8> = matte.values.iter().map(|value| byte(*value)).collect();
        Picture {
            width: matte.width,
            height: matte.height,
            kind: Kind::Grey,
            remark: "coverage by the object, linear",
            bytes: &bytes,
        }
        .write(draft, &format!("{key}.png"))
    })?;
    Ok(run.keys.len())
}

/// Writes `NAME.png` for every view, RGBA with sRGB values times alpha; returns how many.
pub(crate) fn write_premultiplied(run: &Run, draft: &Draft) -> Result<usize, ExportError> {
    run.keys.par_iter().try_for_each(|key| {
        let cutout = run.cutout(key)?;
        let pixels = cutout.colours.iter().zip(&cutout.alpha.values);
        let bytes: Vec<u8> = pixels
            .flat_map(|([r, g, b], alpha)| {
                // With the matte's 16 bits; a colour above its alpha would be none.
                let times = |colour: u8| byte((u32::from(colour) * u32::from(*alpha) / 255) as u16);
                let alpha = byte(*alpha);
                let [r, g, b] = [*r, *g, *b].map(|colour| times(colour).min(alpha));
                [r, g, b, alpha]
            })
            .collect();
        Picture {
            width: cutout.alpha.width,
            height: cutout.alpha.height,
            kind: Kind::Rgba,
            remark: "premultiplied alpha: sRGB values times alpha, against PNG's own convention",
            bytes: &bytes,
        }
        .write(draft, &format!("{key}.png"))
    })?;
    Ok(run.keys.len())
}
