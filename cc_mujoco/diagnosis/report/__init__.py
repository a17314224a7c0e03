"""What a diagnosis writes: page, figures, maps, recording."""
