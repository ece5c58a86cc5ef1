//! A record's layout as data: field names, offsets and types.

/// The layout of a type that may stand in a record.
pub trait Layout {
    /// The type's shape.
    const SHAPE: Shape;
}

/// Shape of a type.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// 8-bit unsigned integer.
    U8,
    /// 32-bit unsigned integer.
    U32,
    /// 64-bit unsigned integer.
    U64,
    /// 64-bit IEEE float.
    F64,
    /// Equal elements, and their number.
    Array(&'static Shape, usize),
    /// A record: its name, its fields in order, its size in bytes.
    Record(&'static str, &'static [Field], usize),
}

/// One field of a record.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// The field's name.
    pub name: &'static str,
    /// Bytes from the record's start.
    pub offset: usize,
    /// Its type.
    pub shape: Shape,
    /// Its documentation: symbol, meaning, unit.
    pub doc: &'static str,
}

impl Layout for u8 {
    const SHAPE: Shape = Shape::U8;
}
impl Layout for u32 {
    const SHAPE: Shape = Shape::U32;
}
impl Layout for u64 {
    const SHAPE: Shape = Shape::U64;
}
impl Layout for f64 {
    const SHAPE: Shape = Shape::F64;
}
impl<T: Layout, const N: usize> Layout for [T; N] {
    const SHAPE: Shape = Shape::Array(&T::SHAPE, N);
}

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// A number that changes whenever a field's name, offset or type changes (64-bit FNV-1a).
///
/// Shared memory compares a type's name, size and alignment but not its fields: the hash goes
/// into the type's name, so that two builds that disagree refuse to connect.
#[must_use]
pub const fn layout_hash<T: Layout>() -> u64 {
    hash_shape(&T::SHAPE, FNV_OFFSET)
}

const fn hash_byte(hash: u64, byte: u8) -> u64 {
    (hash ^ byte as u64).wrapping_mul(FNV_PRIME)
}

const fn hash_number(mut hash: u64, number: usize) -> u64 {
    let bytes = (number as u64).to_le_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = hash_byte(hash, bytes[i]);
        i += 1;
    }
    hash
}

const fn hash_text(mut hash: u64, text: &str) -> u64 {
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        hash = hash_byte(hash, bytes[i]);
        i += 1;
    }
    hash_byte(hash, 0)
}

const fn hash_shape(shape: &Shape, hash: u64) -> u64 {
    match shape {
        Shape::U8 => hash_byte(hash, 1),
        Shape::U32 => hash_byte(hash, 2),
        Shape::U64 => hash_byte(hash, 3),
        Shape::F64 => hash_byte(hash, 4),
        Shape::Array(element, count) => {
            hash_shape(element, hash_number(hash_byte(hash, 5), *count))
        }
        Shape::Record(name, fields, size) => {
            let mut hash = hash_number(hash_text(hash_byte(hash, 6), name), *size);
            let mut i = 0;
            while i < fields.len() {
                hash = hash_number(hash_text(hash, fields[i].name), fields[i].offset);
                hash = hash_shape(&fields[i].shape, hash);
                i += 1;
            }
            hash
        }
    }
}

/// Declares a `#[repr(C)]` record together with its [`Layout`] and a zeroed [`Default`].
macro_rules! record {
    ($(#[doc = $doc:literal])* pub struct $name:ident {
        $( $(#[doc = $field_doc:literal])+ pub $field:ident : $type:ty, )*
    }) => {
        $(#[doc = $doc])*
        #[repr(C)]
        #[derive(
            Debug, Clone, Copy, PartialEq,
            ::zerocopy::FromBytes, ::zerocopy::IntoBytes, ::zerocopy::Immutable,
        )]
        pub struct $name {
            $( $(#[doc = $field_doc])+ pub $field: $type, )*
        }

        impl $crate::layout::Layout for $name {
            const SHAPE: $crate::layout::Shape = $crate::layout::Shape::Record(
                stringify!($name),
                &[$( $crate::layout::Field {
                    name: stringify!($field),
                    offset: ::core::mem::offset_of!($name, $field),
                    shape: <$type as $crate::layout::Layout>::SHAPE,
                    doc: concat!($($field_doc),+),
                }, )*],
                ::core::mem::size_of::<$name>(),
            );
        }

        impl $crate::records::Zero for $name {
            const ZERO: Self = Self { $( $field: <$type as $crate::records::Zero>::ZERO, )* };
        }

        impl Default for $name {
            fn default() -> Self {
                <Self as $crate::records::Zero>::ZERO
            }
        }
    };
}
pub(crate) use record;
