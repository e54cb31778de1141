"""The software painter of pictures and films."""
