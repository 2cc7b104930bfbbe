//! Appends values to the bytes of a section: all little-endian.

use glam::Vec3;

use crate::geometry::Aabb;

/// Appends a section: its tag, its length, its bytes.
pub(super) fn section(out: &mut Vec<u8>, tag: &[u8; 4], bytes: &[u8]) {
    debug_assert!(tag.iter().all(u8::is_ascii_uppercase), "tags are four capital letters");
    out.extend_from_slice(tag);
    out.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
    out.extend_from_slice(bytes);
}

pub(super) fn put_u32(out: &mut Vec<u8>, value: u32) {
    out.extend_from_slice(&value.to_le_bytes());
}

/// Appends the length of a list. The reader takes no longer ones.
pub(super) fn put_count(out: &mut Vec<u8>, count: usize) {
    put_u32(out, u32::try_from(count).expect("no list of a world has 2³² entries"));
}

pub(super) fn put_f32(out: &mut Vec<u8>, value: f32) {
    out.extend_from_slice(&value.to_le_bytes());
}

pub(super) fn put_f64(out: &mut Vec<u8>, value: f64) {
    out.extend_from_slice(&value.to_le_bytes());
}

pub(super) fn put_vec3(out: &mut Vec<u8>, value: Vec3) {
    value.to_array().into_iter().for_each(|c| put_f32(out, c));
}

pub(super) fn put_aabb(out: &mut Vec<u8>, value: &Aabb) {
    put_vec3(out, value.min);
    put_vec3(out, value.max);
}
