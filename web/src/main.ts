// Finds the playback in the page and makes a player of it.
import { parsePlayback } from "./playback";
import { Player } from "./player";

const root = document.getElementById("playback-root");
const data = document.getElementById("playback");
if (root && data?.textContent) new Player(root, parsePlayback(data.textContent));
