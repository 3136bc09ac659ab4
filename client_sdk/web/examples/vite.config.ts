import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";

// An application that has installed the package needs `worker` of this alone: the workers are modules. Here, beside the
// package's source, its imports are of that.
export default defineConfig({
  base: "./",
  worker: { format: "es" },
  build: { target: "es2022", chunkSizeWarningLimit: 1024 },
  resolve: {
    alias: [
      {
        find: /^@terraport\/client\/(\w+)$/,
        replacement: fileURLToPath(new URL("../src/$1/index.ts", import.meta.url)),
      },
    ],
  },
});
