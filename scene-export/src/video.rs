//! The run's pictures as videos, a view a frame, in the order of their names.
//!
//! | file | what |
//! |---|---|
//! | `alpha.mp4` | mattes |
//! | `foreground.mov` | cut-outs with straight alpha, ProRes 4444, for editors |
//! | `foreground.webm` | the same in VP9, for browsers |
//! | `background.mp4` | plates |
//!
//! Views of different sizes are centred in the largest width and height, made even.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::ffmpeg::{Codec, Ffmpeg, Video};
use crate::picture::{Cutout, byte};
use crate::run::Run;

/// Frames a second, unless stated.
pub(crate) const RATE: u32 = 12;
/// Names and codecs.
const VIDEOS: [(&str, Codec); 4] = [
    ("alpha.mp4", Codec::Mp4Grey),
    ("foreground.mov", Codec::ProRes4444),
    ("foreground.webm", Codec::WebmAlpha),
    ("background.mp4", Codec::Mp4Colour),
];
/// How far the object's colours reach beyond its matte, in pixels: codecs mix the colours of neighbours.
const BLEED: usize = 4;

/// Writes all videos; returns the number of frames.
pub(crate) fn write(
    run: &Run,
    rate: u32,
    draft: &Draft,
    notes: &mut Vec<String>,
) -> Result<usize, ExportError> {
    let ffmpeg = Ffmpeg::find()?;
    let mut size = (0, 0);
    for key in &run.keys {
        let matte = run.matte(key)?;
        size = (size.0.max(matte.width), size.1.max(matte.height));
    }
    let size = (size.0.next_multiple_of(2), size.1.next_multiple_of(2));
    let [mut alpha, mut editors, mut browsers, mut background] =
        begin(&ffmpeg, size, rate, draft, notes)?;
    for key in &run.keys {
        let mut cutout = run.cutout(key)?;
        let own = (cutout.alpha.width, cutout.alpha.height);
        let plate = run.rgb("background", key, own)?;
        bleed(&mut cutout);
        let place =
            |pixel: &dyn Fn(usize, &mut [u8]), bytes: usize| centred(own, size, bytes, pixel);
        let (values, colours) = (&cutout.alpha.values, &cutout.colours);
        if let Some(video) = &mut alpha {
            video.push(&place(&|i, out| out[0] = byte(values[i]), 1))?;
        }
        if let Some(video) = &mut editors {
            video.push(&place(
                &|i, out| {
                    let [r, g, b] = colours[i].map(|c| u16::from(c) * 257);
                    for (out, word) in out.chunks_exact_mut(2).zip([r, g, b, values[i]]) {
                        out.copy_from_slice(&word.to_le_bytes());
                    }
                },
                8,
            ))?;
        }
        if let Some(video) = &mut browsers {
            video.push(&place(
                &|i, out| {
                    out[..3].copy_from_slice(&colours[i]);
                    out[3] = byte(values[i]);
                },
                4,
            ))?;
        }
        if let Some(video) = &mut background {
            video.push(&place(&|i, out| out.copy_from_slice(&plate[i]), 3))?;
        }
    }
    for video in [alpha, editors, browsers, background].into_iter().flatten() {
        video.finish()?;
    }
    Ok(run.keys.len())
}

/// The videos in the order of [`VIDEOS`], with a note for each that this ffmpeg cannot write; it has to write one.
fn begin(
    ffmpeg: &Ffmpeg,
    size: (u32, u32),
    rate: u32,
    draft: &Draft,
    notes: &mut Vec<String>,
) -> Result<[Option<Video>; VIDEOS.len()], ExportError> {
    if !VIDEOS.iter().any(|(_, codec)| ffmpeg.can(*codec)) {
        return Err(ffmpeg.can_nothing());
    }
    let mut videos = [const { None }; VIDEOS.len()];
    for (video, (name, codec)) in videos.iter_mut().zip(VIDEOS) {
        if ffmpeg.can(codec) {
            *video = Some(ffmpeg.begin(&draft.place(name)?, size, rate, codec)?);
        } else {
            notes.push(format!("no {name}: this ffmpeg has no encoder for it"));
        }
    }
    Ok(videos)
}

/// A picture in the middle of a frame that is zero around it.
fn centred(
    own: (u32, u32),
    size: (u32, u32),
    bytes: usize,
    pixel: &dyn Fn(usize, &mut [u8]),
) -> Vec<u8> {
    let [w, h, width, height] = [own.0, own.1, size.0, size.1].map(|side| side as usize);
    let (left, top) = ((width - w) / 2, (height - h) / 2);
    let mut frame = vec![0; width * height * bytes];
    for y in 0..h {
        let start = ((y + top) * width + left) * bytes;
        let row = &mut frame[start..start + w * bytes];
        for (x, out) in row.chunks_exact_mut(bytes).enumerate() {
            pixel(y * w + x, out);
        }
    }
    frame
}

/// Beyond the matte the object's colours are carried on a little, and then black: whoever leaves out
/// alpha sees the object alone.
fn bleed(cutout: &mut Cutout) {
    let (w, h) = (cutout.alpha.width as usize, cutout.alpha.height as usize);
    let mut known: Vec<bool> = cutout.alpha.values.iter().map(|alpha| *alpha > 0).collect();
    let colours = &mut cutout.colours;
    for (colour, known) in colours.iter_mut().zip(&known) {
        if !known {
            *colour = [0; 3];
        }
    }
    for _ in 0..BLEED {
        let before = known.clone();
        for i in 0..w * h {
            if before[i] {
                continue;
            }
            let (x, y) = (i % w, i / w);
            let (mut sum, mut count) = ([0u32; 3], 0u32);
            for (there, j) in [
                (x > 0, i.wrapping_sub(1)),
                (x + 1 < w, i + 1),
                (y > 0, i.wrapping_sub(w)),
                (y + 1 < h, i + w),
            ] {
                if there && before[j] {
                    count += 1;
                    for (sum, value) in sum.iter_mut().zip(colours[j]) {
                        *sum += u32::from(value);
                    }
                }
            }
            if count > 0 {
                colours[i] = sum.map(|sum| (sum / count) as u8);
                known[i] = true;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::picture::Matte;

    #[cfg(unix)]
    #[test]
    fn without_any_encoder_there_is_no_export() {
        use crate::ffmpeg::script;
        let dir = tempfile::tempdir().unwrap();
        let draft = Draft::begin(&dir.path().join("out"), crate::Existing::Keep).unwrap();
        let begun = |encoder: &str| {
            let text = format!(
                "case \"$*\" in *-encoders*) echo ' V....D {encoder}  a'; exit 0;; esac\ncat >&2\n"
            );
            let ffmpeg = Ffmpeg::at(&script(dir.path(), &text)).unwrap();
            let mut notes = Vec::new();
            let videos = begin(&ffmpeg, (2, 2), 12, &draft, &mut notes)?;
            Ok::<_, ExportError>((videos.map(|video| video.is_some()), notes))
        };
        let said = begun("gif").unwrap_err().to_string();
        assert!(
            said.contains("no encoder for any of the videos; install"),
            "{said}"
        );
        let (videos, notes) = begun("prores_ks").unwrap();
        assert_eq!(videos, [false, true, false, false]);
        assert_eq!(notes.len(), 3);
        assert!(notes[0].starts_with("no alpha.mp4: "), "{notes:?}");
    }

    #[test]
    fn frames_are_centred() {
        let frame = centred((1, 1), (4, 3), 1, &|_, out| out[0] = 9);
        assert_eq!(frame, [0, 0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn colours_reach_a_little_beyond_the_matte() {
        let mut cutout = Cutout {
            alpha: Matte {
                width: 8,
                height: 1,
                values: vec![65535, 0, 0, 0, 0, 0, 0, 0],
            },
            colours: vec![[7, 8, 9]; 8],
        };
        bleed(&mut cutout);
        assert_eq!(cutout.colours[..5], [[7, 8, 9]; 5]);
        assert_eq!(cutout.colours[5..], [[0; 3]; 3]);
    }
}
