//! Generates the messages of a recording from `leg.proto`, without `protoc`.

use std::error::Error;
use std::path::PathBuf;

use prost::Message;
use protox::prost_reflect::prost_types::FileDescriptorSet;
use protox::prost_reflect::prost_types::field_descriptor_proto::Type;

const FOLDER: &str = "src";
const PROTO: &str = "leg.proto";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={FOLDER}/{PROTO}");
    let mut compiler = protox::Compiler::new([FOLDER])?;
    let mut files = compiler.include_source_info(true).open_file(PROTO)?.file_descriptor_set();

    let mut config = prost_build::Config::new();
    config.enable_type_names();
    for path in floats(&files) {
        // proto3 omits a field that compares equal to 0, and would lose the sign of -0.
        config.field_attribute(path, "#[prost(required)]");
    }
    config.compile_fds(files.clone())?;

    // Every MCAP schema carries the descriptors; the comments would only cost space.
    for file in &mut files.file {
        file.source_code_info = None;
    }
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("leg.fds"), files.encode_to_vec())?;
    Ok(())
}

/// Returns the full names of all fields of type `float` or `double`.
fn floats(files: &FileDescriptorSet) -> Vec<String> {
    let messages = files.file.iter().flat_map(|file| &file.message_type);
    let float = |t: Type| matches!(t, Type::Float | Type::Double);
    messages
        .flat_map(|message| {
            let floats = message.field.iter().filter(|field| float(field.r#type()));
            floats.map(|field| format!(".leg.{}.{}", message.name(), field.name()))
        })
        .collect()
}
