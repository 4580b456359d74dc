// Contacts of the arm, one line each: node contacts.mjs [VIEW_SOCKET]
// Node has no sockets with message boundaries; contactctl hands it the States, a line each.
import { spawn } from "node:child_process";
import { createInterface } from "node:readline";

const door = process.argv[2] ?? "/run/contactd/contactd-view.sock";
const watch = spawn("contactctl", ["--socket", door, "watch", "--json"], {
  stdio: ["ignore", "pipe", "inherit"],
});
watch.on("error", (error) => {
  console.error(`contactctl: ${error.message}`);
  process.exitCode = 1;
});
watch.on("exit", (code) => {
  process.exitCode = code ?? 1; // 69: the daemon is gone
});
for await (const line of createInterface({ input: watch.stdout })) {
  const state = JSON.parse(line);
  for (const { contact } of state.notices) {
    if (contact) console.log(state.time_s, contact.joint, contact.torque, contact.level);
  }
}
