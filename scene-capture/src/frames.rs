//! Taking the sharpest frame of each window of time from a video.
//!
//! ffmpeg decodes once, and hands over candidates whole through a pipe. Whatever is not the
//! sharpest of its window is forgotten, as is a frame that shows what the last one showed.

use crate::error::CaptureError;
use crate::program::LastLines;
use crate::sharpness::Grey;
use crate::video::{Ffmpeg, FrameOptions, VideoInfo, Windows, file_url};
use crate::watch::{Progress, Stage, Watch};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write as _};
use std::path::Path;

/// Nearly lossless, as what a video's compression left is all there is.
const JPEG_QUALITY: u8 = 95;
/// A picture of more pixels is taken for damage.
const MOST_PIXELS: usize = 1 << 28;
/// Frames to reconstruct anything from.
const FEWEST: usize = 3;

/// What was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TakenFrames {
    /// Number of frames written: `frame_00001.jpg` and so on.
    pub frames: usize,
    /// Decisions taken, one sentence each.
    pub notes: Vec<String>,
}

impl Ffmpeg {
    /// Writes the sharpest frame of each window of time as JPEG into a folder that exists.
    ///
    /// # Errors
    /// [`CaptureError`] if the file is no video, too short, or shows one picture only.
    pub fn take_frames(
        &self,
        video: &Path,
        out: &Path,
        options: &FrameOptions,
        watch: &dyn Watch,
    ) -> Result<TakenFrames, CaptureError> {
        let info = self.probe(video)?;
        let windows = Windows::over(&info, options);
        let (mut running, lines) = self
            .ffmpeg
            .start(&arguments(video, &info, &windows), false)?;
        let Some(pipe) = running.child.stdout.take() else {
            // Unreachable: a pipe was asked for.
            return Err(CaptureError::bad(
                video,
                "ffmpeg has no output",
                "try again",
            ));
        };
        let mut pipe = BufReader::with_capacity(1 << 20, pipe);
        let mut chooser = Chooser::new(out);
        let total = windows.count * windows.candidates;
        let mut seen = 0;
        loop {
            if watch.interrupted() {
                return Err(CaptureError::Interrupted);
            }
            let picture = match Picture::read(&mut pipe) {
                Ok(Some(picture)) => picture,
                Ok(None) => break,
                // The program ended in the middle of a picture; how, is seen below.
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
                Err(error) => return Err(CaptureError::io("read", video, error)),
            };
            chooser.look(windows.of(seen), picture)?;
            seen += 1;
            watch.progress(Progress {
                stage: Stage::Frames,
                done: seen.min(total),
                total,
            });
        }
        let status = running.end(watch)?;
        let mut last = LastLines::default();
        lines.iter().for_each(|line| last.push(line));
        let complaint = last.reason();
        if !status.success() {
            return Err(CaptureError::bad(
                video,
                format!(
                    "ffmpeg cannot decode it ({})",
                    complaint.unwrap_or_else(|| status.to_string())
                ),
                "copy it again, or convert it to MP4",
            ));
        }
        let size = chooser.size;
        let (frames, still) = chooser.finish()?;
        if frames < FEWEST {
            return Err(CaptureError::bad(
                video,
                if still > 0 {
                    format!("nothing moves in it: {frames} of its frames differ from each other")
                } else {
                    format!(
                        "it gives only {frames} frames in its {:.1} seconds",
                        info.seconds
                    )
                },
                "film the object from all around, for half a minute or longer",
            ));
        }
        let notes = notes(&info, &windows, size, (frames, still), complaint);
        Ok(TakenFrames { frames, notes })
    }
}

fn notes(
    info: &VideoInfo,
    windows: &Windows,
    size: (usize, usize),
    (frames, still): (usize, usize),
    complaint: Option<String>,
) -> Vec<String> {
    let mut notes = vec![format!(
        "{frames} frames of {}x{} are taken from {:.1} seconds of video, each the sharpest of {}",
        size.0, size.1, info.seconds, windows.candidates
    )];
    if info.is_interlaced {
        notes.push(
            "the video is interlaced: its pictures have rows of two moments, of which one is kept, with half the detail; \
             film or export it as progressive for all of it"
                .to_owned(),
        );
    }
    if still > 0 {
        notes.push(format!(
            "nothing had moved since the frame before in {still} of {} moments, which are left out",
            windows.count
        ));
    }
    if info.is_hdr {
        notes.push(
            "the video is HDR, so its colours come out flat; film or export it as SDR for true ones"
                .to_owned(),
        );
    }
    if let Some(complaint) = complaint {
        notes.push(format!("ffmpeg complained about the video: {complaint}"));
    }
    notes
}

/// Pictures as PPM, which say their size themselves, turned as they are shown.
fn arguments(video: &Path, info: &VideoInfo, windows: &Windows) -> Vec<OsString> {
    let mut filter = String::new();
    if info.is_interlaced {
        // Before any picture is left out: it looks at those before and after.
        filter.push_str("yadif=deint=interlaced,");
    }
    filter.push_str(&format!("fps={:.6}", windows.rate));
    if (info.pixel_aspect - 1.0).abs() > 1e-3 {
        // Cameras of square pixels are what COLMAP's models begin with.
        filter.push_str(",scale=iw*sar:ih,setsar=1");
    }
    // Of what has more than 8 bits, as HDR does, PPM would have 16.
    filter.push_str(",format=rgb24");
    let mut words: Vec<OsString> = ["-hide_banner", "-nostdin", "-loglevel", "error", "-i"]
        .map(OsString::from)
        .into();
    words.push(file_url(video));
    words.extend(["-map", "0:V:0", "-vf", &filter].map(OsString::from));
    words.extend(["-f", "image2pipe", "-c:v", "ppm", "-"].map(OsString::from));
    words
}

/// An 8-bit RGB picture.
#[derive(Debug)]
struct Picture {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Picture {
    /// The next binary PPM; `None` where the stream ends.
    fn read(from: &mut impl Read) -> io::Result<Option<Picture>> {
        let mut magic = [0; 2];
        loop {
            match from.read(&mut magic[..1]) {
                Ok(0) => return Ok(None),
                Ok(_) => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        from.read_exact(&mut magic[1..])?;
        let odd = || io::Error::new(io::ErrorKind::InvalidData, "ffmpeg sent no pictures");
        if &magic != b"P6" {
            return Err(odd());
        }
        let [width, height, depth] = [number(from)?, number(from)?, number(from)?];
        let pixels = width.checked_mul(height).filter(|n| *n <= MOST_PIXELS);
        let (Some(pixels), 255) = (pixels, depth) else {
            return Err(odd());
        };
        let mut rgb = vec![0; 3 * pixels];
        from.read_exact(&mut rgb)?;
        Ok(Some(Picture { width, height, rgb }))
    }

    fn write(&self, to: &Path) -> Result<(), CaptureError> {
        let failed = |e| CaptureError::io("write", to, e);
        let mut out = BufWriter::new(File::create(to).map_err(failed)?);
        JpegEncoder::new_with_quality(&mut out, JPEG_QUALITY)
            .encode(
                &self.rgb,
                self.width as u32,
                self.height as u32,
                ExtendedColorType::Rgb8,
            )
            .map_err(|e| failed(io_colmap::picture_error(e)))?;
        out.flush().map_err(failed)
    }
}

/// A number between blanks; the one blank after it is read too.
fn number(from: &mut impl Read) -> io::Result<usize> {
    let mut value: Option<usize> = None;
    let mut byte = [0];
    loop {
        from.read_exact(&mut byte)?;
        match (byte[0], value) {
            (digit @ b'0'..=b'9', _) => {
                let digits = value.unwrap_or_default().saturating_mul(10);
                value = Some(digits.saturating_add(usize::from(digit - b'0')));
            }
            (b' ' | b'\n' | b'\t' | b'\r', None) => {}
            (b' ' | b'\n' | b'\t' | b'\r', Some(value)) => return Ok(value),
            _ => {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    "ffmpeg sent no pictures",
                ));
            }
        }
    }
}

/// Keeps the sharpest picture of the window that is open, and writes it when the next begins.
#[derive(Debug)]
struct Chooser<'a> {
    out: &'a Path,
    /// Of the first picture, which the others have too.
    size: (usize, usize),
    window: usize,
    best: Option<(f64, Grey, Picture)>,
    /// Of the frame that was written last.
    last: Option<Grey>,
    written: usize,
    still: usize,
}

impl<'a> Chooser<'a> {
    fn new(out: &'a Path) -> Self {
        Self {
            out,
            size: (0, 0),
            window: 0,
            best: None,
            last: None,
            written: 0,
            still: 0,
        }
    }

    fn look(&mut self, window: usize, picture: Picture) -> Result<(), CaptureError> {
        if window != self.window {
            self.close()?;
            self.window = window;
        }
        if self.size == (0, 0) {
            self.size = (picture.width, picture.height);
        }
        let grey = Grey::of_rgb(&picture.rgb, picture.width, picture.height);
        let sharpness = grey.sharpness();
        if self.best.as_ref().is_none_or(|best| sharpness > best.0) {
            self.best = Some((sharpness, grey, picture));
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), CaptureError> {
        let Some((_, grey, picture)) = self.best.take() else {
            return Ok(());
        };
        let thumbnail = grey.thumbnail();
        if self
            .last
            .as_ref()
            .is_some_and(|last| !thumbnail.differs_from(last))
        {
            self.still += 1;
            return Ok(());
        }
        self.written += 1;
        let name = format!("frame_{:05}.jpg", self.written);
        picture.write(&self.out.join(name))?;
        self.last = Some(thumbnail);
        Ok(())
    }

    /// How many frames were written, and how many showed nothing new.
    fn finish(mut self) -> Result<(usize, usize), CaptureError> {
        self.close()?;
        Ok((self.written, self.still))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn picture(value: u8, contrast: u8) -> Picture {
        let rgb = (0..64 * 48)
            .flat_map(|i| [value + contrast * u8::from(i / 8 % 2 == 0); 3])
            .collect();
        Picture {
            width: 64,
            height: 48,
            rgb,
        }
    }

    #[test]
    fn the_sharpest_of_each_window_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let mut chooser = Chooser::new(dir.path());
        // Windows of: two pictures; one that shows the same; another one.
        chooser.look(0, picture(0, 50)).unwrap();
        chooser.look(0, picture(10, 100)).unwrap();
        chooser.look(1, picture(10, 100)).unwrap();
        chooser.look(2, picture(60, 100)).unwrap();
        assert_eq!(chooser.finish().unwrap(), (2, 1));
        let read = |name: &str| image::open(dir.path().join(name)).unwrap().into_rgb8();
        let first = read("frame_00001.jpg");
        assert!(first.get_pixel(3, 3).0[0].abs_diff(110) < 5);
        assert!(read("frame_00002.jpg").get_pixel(3, 3).0[0].abs_diff(160) < 5);
        assert_eq!(Chooser::new(dir.path()).finish().unwrap(), (0, 0));
    }

    #[test]
    fn a_stream_of_pictures_is_read_to_its_end() {
        let mut stream: &[u8] = b"P6\n2 1\n255\nabcdefP6 1 1 255 xyz";
        let first = Picture::read(&mut stream).unwrap().unwrap();
        assert_eq!(
            (first.width, first.height, &*first.rgb),
            (2, 1, &b"abcdef"[..])
        );
        let second = Picture::read(&mut stream).unwrap().unwrap();
        assert_eq!(&*second.rgb, b"xyz");
        assert!(Picture::read(&mut stream).unwrap().is_none());
    }

    #[test]
    fn damaged_streams_are_errors() {
        for (stream, kind) in [
            (&b"P6\n2 1\n255\nabc"[..], io::ErrorKind::UnexpectedEof),
            (b"P", io::ErrorKind::UnexpectedEof),
            (b"P6\n2", io::ErrorKind::UnexpectedEof),
            (b"P5\n2 1\n255\nab", io::ErrorKind::InvalidData),
            (b"P6\n2 1\n65535\nabcdefabcdef", io::ErrorKind::InvalidData),
            (
                b"P6\n99999999999999999999999 9999\n255\n",
                io::ErrorKind::InvalidData,
            ),
            (b"P6\n-2 1\n255\n", io::ErrorKind::InvalidData),
        ] {
            let mut stream = stream;
            assert_eq!(Picture::read(&mut stream).unwrap_err().kind(), kind);
        }
    }

    #[test]
    fn ffmpeg_is_asked_for_candidates_only() {
        let info = VideoInfo {
            size: (64, 48),
            seconds: 60.0,
            rate: 30.0,
            rotation: 90,
            pixel_aspect: 1.0,
            is_hdr: false,
            is_interlaced: false,
        };
        let windows = Windows::over(&info, &FrameOptions::default());
        let line = |info: &VideoInfo| {
            let words = arguments(Path::new("-a:b.mp4"), info, &windows);
            let words: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
            words.join(" ")
        };
        assert_eq!(
            line(&info),
            "-hide_banner -nostdin -loglevel error -i file:-a:b.mp4 -map 0:V:0 -vf \
             fps=10.000000,format=rgb24 -f image2pipe -c:v ppm -"
        );
        let wide = VideoInfo {
            pixel_aspect: 1.42,
            ..info.clone()
        };
        assert!(line(&wide).contains("-vf fps=10.000000,scale=iw*sar:ih,setsar=1,format=rgb24 -f"));
        let interlaced = VideoInfo {
            is_interlaced: true,
            ..info
        };
        assert!(
            line(&interlaced).contains("-vf yadif=deint=interlaced,fps=10.000000,format=rgb24 -f")
        );
    }
}
