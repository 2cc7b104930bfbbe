//! Every kind of file compared with another decoder: the crate `image`.

use std::io::Cursor;

use image::{
    DynamicImage, ExtendedColorType, GrayImage, ImageEncoder, ImageFormat, ImageReader, RgbImage,
    codecs::{jpeg::JpegEncoder, tga::TgaEncoder},
    imageops,
};
use png::{BitDepth, ColorType};
use sightline_picture::{DecodeError, DecodeLimits, Encoding, Picture, decode};

const LIMITS: DecodeLimits = DecodeLimits { edge_max: 4096, bytes_max: 1 << 24 };

/// Bytes that look random.
fn noise(count: usize) -> Vec<u8> {
    let step = |state: &mut u32| {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some((*state >> 24) as u8)
    };
    std::iter::repeat_n((), count).scan(7, |state, ()| step(state)).collect()
}

/// What the other decoder makes of a file.
fn reference(bytes: &[u8], encoding: Encoding) -> Option<Picture> {
    let reader = match encoding {
        Encoding::Tga => ImageReader::with_format(Cursor::new(bytes), ImageFormat::Tga),
        Encoding::Marked => ImageReader::new(Cursor::new(bytes)).with_guessed_format().unwrap(),
    };
    let picture = reader.decode().ok()?.into_rgb8();
    let pixels = picture.pixels().map(|pixel| pixel.0).collect();
    Picture::from_pixels(picture.width(), picture.height(), pixels)
}

/// Both decoders give the same pixels.
fn check(name: &str, bytes: &[u8], encoding: Encoding) {
    let expected = reference(bytes, encoding).unwrap_or_else(|| panic!("{name}: no reference"));
    let found = decode(bytes, encoding, LIMITS).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert!(found == expected, "{name}: the pixels differ");
}

fn png(
    colour: ColorType,
    depth: BitDepth,
    extras: impl Fn(&mut png::Encoder<&mut Vec<u8>>),
) -> Vec<u8> {
    let (width, height) = (19, 11);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    extras(&mut encoder);
    let row = (width as usize * colour.samples() * depth as usize).div_ceil(8);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&noise(row * height as usize)).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn every_kind_of_png_decodes_to_the_same_pixels() {
    use BitDepth::{Eight, Four, One, Sixteen, Two};
    let kinds = [
        (ColorType::Grayscale, &[One, Two, Four, Eight, Sixteen][..]),
        (ColorType::GrayscaleAlpha, &[Eight, Sixteen]),
        (ColorType::Rgb, &[Eight, Sixteen]),
        (ColorType::Rgba, &[Eight, Sixteen]),
        (ColorType::Indexed, &[One, Two, Four, Eight]),
    ];
    for (colour, depths) in kinds {
        for &depth in depths {
            let is_indexed = colour == ColorType::Indexed;
            let file = png(colour, depth, |encoder| {
                if is_indexed {
                    encoder.set_palette(noise(3 << depth as usize));
                }
            });
            check(&format!("{colour:?}, {depth:?}"), &file, Encoding::Marked);
            // One transparent colour, or the transparency of each entry of the palette.
            let transparent: Option<usize> = match colour {
                ColorType::Grayscale => Some(2),
                ColorType::Rgb => Some(6),
                ColorType::Indexed => Some(1 << depth as usize),
                _ => None,
            };
            if let Some(count) = transparent {
                let file = png(colour, depth, |encoder| {
                    if is_indexed {
                        encoder.set_palette(noise(3 << depth as usize));
                    }
                    encoder.set_trns(if is_indexed { noise(count) } else { vec![0; count] });
                });
                check(&format!("{colour:?}, {depth:?}, tRNS"), &file, Encoding::Marked);
            }
        }
    }
    let file = png(ColorType::Rgb, Eight, |encoder| {
        encoder.set_source_gamma(png::ScaledFloat::new(0.8));
    });
    check("a gamma is left alone", &file, Encoding::Marked);
}

#[test]
fn jpegs_decode_to_the_same_pixels() {
    let (width, height) = (37, 21);
    for quality in [20, 90] {
        for (name, kind, channels) in
            [("colour", ExtendedColorType::Rgb8, 3), ("grey", ExtendedColorType::L8, 1)]
        {
            let mut bytes = Vec::new();
            let pixels = noise(width * height * channels);
            let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
            encoder.write_image(&pixels, width as u32, height as u32, kind).unwrap();
            check(&format!("{name}, {quality}"), &bytes, Encoding::Marked);
        }
    }
}

/// A TGA file of 6 × 5 pixels.
fn tga(kind: u8, bits: u8, descriptor: u8, palette: Option<(u8, u8)>, body: &[u8]) -> Vec<u8> {
    let (entries, entry_bits) = palette.unwrap_or((0, 0));
    let mut bytes = vec![3, u8::from(palette.is_some()), kind, 1, 0, entries, 0, entry_bits];
    bytes.extend([0, 0, 0, 0, 6, 0, 5, 0, bits, descriptor]);
    bytes.extend(b"any");
    bytes.extend(noise(usize::from(entries) * usize::from(entry_bits.div_ceil(8))));
    bytes.extend(body);
    bytes
}

#[test]
fn every_kind_of_tga_decodes_to_the_same_pixels() {
    for direction in [0x00, 0x10, 0x20, 0x30] {
        // The low bits of the descriptor say how many bits of a pixel are alpha.
        for (kind, bits, alpha) in
            [(2, 24, 0), (2, 32, 8), (2, 16, 0), (2, 16, 1), (3, 8, 0), (3, 16, 8)]
        {
            let size = usize::from(bits / 8);
            let name = format!("kind {kind}, {bits} bits, {alpha}, {direction:#x}");
            let raw = tga(kind, bits, direction | alpha, None, &noise(30 * size));
            check(&name, &raw, Encoding::Tga);
            // A run of 20, 3 raw pixels, and a run that reaches beyond the end.
            let values = noise(5 * size);
            let mut packets = vec![0x80 + 19];
            packets.extend(&values[..size]);
            packets.push(2);
            packets.extend(&values[size..4 * size]);
            packets.push(0xff);
            packets.extend(&values[4 * size..]);
            let packed = tga(kind + 8, bits, direction | alpha, None, &packets);
            check(&format!("{name}, packed"), &packed, Encoding::Tga);
        }
        // Palettes begin at index 1.
        for (entry_bits, alpha) in [(16, 0), (24, 0), (32, 8)] {
            let indices: Vec<u8> = noise(30).iter().map(|index| 1 + index % 40).collect();
            let file = tga(1, 8, direction | alpha, Some((40, entry_bits)), &indices);
            check(&format!("palette of {entry_bits} bits"), &file, Encoding::Tga);
            let wide: Vec<u8> = indices.iter().flat_map(|&index| [index, 0]).collect();
            let file = tga(1, 16, direction | alpha, Some((40, entry_bits)), &wide);
            check(&format!("palette of {entry_bits} bits, wide"), &file, Encoding::Tga);
        }
    }
    let mut bytes = Vec::new();
    TgaEncoder::new(&mut bytes).write_image(&noise(300), 10, 10, ExtendedColorType::Rgb8).unwrap();
    check("as written by another program", &bytes, Encoding::Tga);
}

#[test]
fn damaged_files_are_errors() {
    let mut jpeg = Vec::new();
    GrayImage::from_raw(8, 8, noise(64))
        .map(DynamicImage::from)
        .unwrap()
        .write_to(&mut Cursor::new(&mut jpeg), ImageFormat::Jpeg)
        .unwrap();
    let files = [
        (png(ColorType::Rgb, BitDepth::Eight, |_| ()), Encoding::Marked),
        (jpeg, Encoding::Marked),
        (tga(10, 24, 0x20, None, &[0x9d, 1, 2, 3]), Encoding::Tga),
        (tga(1, 8, 0x20, Some((9, 24)), &[1; 30]), Encoding::Tga),
    ];
    for (file, encoding) in &files {
        assert!(decode(file, *encoding, LIMITS).is_ok());
        for length in 0..file.len() {
            // A JPEG whose end is missing may decode; nothing panics.
            let cut = decode(&file[..length], *encoding, LIMITS);
            assert!(cut.is_err() || length > 20, "{encoding:?}, {length} bytes");
        }
        for place in 0..file.len() {
            for bit in 0..8 {
                let mut damaged = file.clone();
                damaged[place] ^= 1 << bit;
                let _ = decode(&damaged, *encoding, LIMITS);
            }
        }
    }
    assert!(matches!(decode(b"GIF89a", Encoding::Marked, LIMITS), Err(DecodeError::Unmarked)));
}

#[test]
fn files_beyond_the_limits_are_refused() {
    let file = png(ColorType::Rgb, BitDepth::Eight, |_| ());
    let tga = tga(2, 24, 0, None, &noise(90));
    for (edge_max, bytes_max, is_good) in
        [(19, 1 << 20, true), (5, 1 << 20, false), (19, 80, false)]
    {
        let limits = DecodeLimits { edge_max, bytes_max };
        assert_eq!(decode(&file, Encoding::Marked, limits).is_ok(), is_good, "{limits:?}");
        assert_eq!(decode(&tga, Encoding::Tga, limits).is_ok(), is_good, "{limits:?}");
    }
}

#[test]
fn what_is_written_is_read_and_is_the_same_file() {
    let pixels = noise(33 * 17 * 3);
    let other = RgbImage::from_raw(33, 17, pixels.clone()).unwrap();
    let picture = Picture::from_pixels(33, 17, pixels.as_chunks().0.to_vec()).unwrap();
    let written = picture.to_png().unwrap();
    let mut expected = Vec::new();
    other.write_to(&mut Cursor::new(&mut expected), ImageFormat::Png).unwrap();
    assert!(written == expected, "the files differ");
    assert_eq!(decode(&written, Encoding::Marked, LIMITS).unwrap(), picture);
}

#[test]
fn scaling_down_gives_the_same_means() {
    for (width, height) in [(256, 64), (129, 128), (300, 7), (512, 512), (1000, 333)] {
        let pixels = noise(width * height * 3);
        let (width, height) = (width as u32, height as u32);
        let other = RgbImage::from_raw(width, height, pixels.clone()).unwrap();
        let picture = Picture::from_pixels(width, height, pixels.as_chunks().0.to_vec()).unwrap();
        for edge in [128, 50] {
            let (new_width, new_height) = (width.min(edge), height.min(edge));
            let expected = imageops::thumbnail(&other, new_width, new_height);
            let scaled = picture.scaled_down(new_width, new_height);
            assert!(
                scaled.pixels().as_flattened() == expected.as_raw(),
                "{width} × {height} to {edge}"
            );
        }
    }
}
