using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Threading;

namespace Terraport
{
    /// <summary>
    /// Payloads on disk, from one run to the next, on a thread of its own. Bounded in bytes over all scenes; what was used longest ago goes
    /// first. Nothing here throws: a disk that is full, damaged or read-only keeps less, or nothing.
    /// </summary>
    /// <remarks>
    /// ROOT/scene-ID/KEY-BOX.segment-2, with the content key in 16 hexadecimal digits and the box as six float32 in 8 digits each: the names
    /// say what is there, no file is opened before it is needed. Decoding a payload checks it.
    /// </remarks>
    internal sealed class DiskCache : IDisposable
    {
        // When full, down to this part of the bound, so that not every write lists the folder.
        private const double Room = 0.9;

        // Payload that waits to be written at most; more is not kept.
        private const long MaxWaitingBytes = 32 << 20;
        private const string Ending = ".segment-2", Unfinished = ".tmp";

        private readonly string root, folder;
        private readonly long maxBytes;
        // Guards the fields below.
        private readonly object gate = new object();
        private readonly Queue<Action> work = new Queue<Action>();
        private readonly Queue<KeyValuePair<ulong, byte[]>> results = new Queue<KeyValuePair<ulong, byte[]>>();
        private Dictionary<ulong, Box> index;
        private long waitingBytes;
        private bool isClosed;
        // Of the thread: bytes of all scenes, and whether writing is worth an attempt.
        private long bytes;
        private bool isWritable = true;

        /// <summary>Begin to list what is there.</summary>
        internal DiskCache(string root, string sceneId, long maxBytes)
        {
            this.root = root;
            this.maxBytes = maxBytes;
            folder = Path.Combine(root, "scene-" + Uri.EscapeDataString(sceneId));
            Enqueue(List);
            new Thread(Work) { Name = "terraport disk", IsBackground = true }.Start();
        }

        /// <summary>Boxes by key of what was there at the start; null while it is listed. Given once, then empty.</summary>
        internal Dictionary<ulong, Box> TakeIndex()
        {
            lock (gate)
            {
                Dictionary<ulong, Box> taken = index;
                if (taken != null) index = new Dictionary<ulong, Box>();
                return taken;
            }
        }

        /// <summary>Read a payload; <see cref="TryTake"/> has it later.</summary>
        internal void Read(ulong key, Box box)
        {
            Enqueue(() =>
                {
                    byte[] payload = null;
                    string path = PathOf(key, box);
                    if (Try(() => payload = File.ReadAllBytes(path))) Try(() => File.SetLastWriteTimeUtc(path, DateTime.UtcNow));
                    lock (gate) results.Enqueue(new KeyValuePair<ulong, byte[]>(key, payload));
                });
        }

        /// <summary>Take a payload that was read; null where it could not be.</summary>
        internal bool TryTake(out KeyValuePair<ulong, byte[]> result)
        {
            lock (gate)
            {
                bool any = results.Count > 0;
                result = any ? results.Dequeue() : default;
                return any;
            }
        }

        /// <summary>Keep a payload, soon.</summary>
        internal void Put(ulong key, Box box, byte[] payload)
        {
            lock (gate)
            {
                if (waitingBytes + payload.Length > MaxWaitingBytes) return;
                waitingBytes += payload.Length;
            }
            Enqueue(() =>
                {
                    Write(PathOf(key, box), payload);
                    lock (gate) waitingBytes -= payload.Length;
                });
        }

        /// <summary>Delete a payload that is damaged.</summary>
        internal void Remove(ulong key, Box box) { Enqueue(() => Try(() => File.Delete(PathOf(key, box)))); }

        /// <summary>Drop what waits; the file in hand is finished.</summary>
        public void Dispose()
        {
            lock (gate)
            {
                isClosed = true;
                Monitor.Pulse(gate);
            }
        }

        private void Enqueue(Action action)
        {
            lock (gate)
            {
                work.Enqueue(action);
                Monitor.Pulse(gate);
            }
        }

        private void Work()
        {
            for (;;)
            {
                Action next;
                lock (gate)
                {
                    while (work.Count == 0 && !isClosed) Monitor.Wait(gate);
                    if (isClosed) return;
                    next = work.Dequeue();
                }
                next();
            }
        }

        private void List()
        {
            var boxes = new Dictionary<ulong, Box>();
            foreach (FileInfo file in Files())
            {
                if (file.DirectoryName == new DirectoryInfo(folder).FullName && TryParse(file.Name, out ulong key, out Box box))
                    boxes[key] = box;
            }
            lock (gate) index = boxes;
        }

        private void Write(string path, byte[] payload)
        {
            if (!isWritable || payload.Length > maxBytes) return;
            string unfinished = Path.Combine(folder, Guid.NewGuid().ToString("N") + Unfinished);
            isWritable = Try(() =>
                {
                    if (File.Exists(path)) return;
                    if (bytes + payload.Length > maxBytes) MakeRoom(payload.Length);
                    Directory.CreateDirectory(folder);
                    // Written under another name and renamed: no reader sees half a file.
                    File.WriteAllBytes(unfinished, payload);
                    File.Move(unfinished, path);
                    bytes += payload.Length;
                });
            // A folder that cannot be written is not tried again: each attempt would cost as much as a write.
            if (!isWritable) Try(() => File.Delete(unfinished));
        }

        private void MakeRoom(long needed)
        {
            foreach (FileInfo file in Files())
            {
                if (bytes <= maxBytes * Room - needed) return;
                if (Try(file.Delete)) bytes -= file.Length;
            }
        }

        /// <summary>Files of all scenes, used longest ago first; counts their bytes.</summary>
        private List<FileInfo> Files()
        {
            var files = new List<FileInfo>();
            Try(() =>
                {
                    if (!Directory.Exists(root)) return;
                    // What is not ours stays.
                    foreach (DirectoryInfo scene in new DirectoryInfo(root).GetDirectories("scene-*"))
                    {
                        files.AddRange(scene.GetFiles("*" + Ending).Concat(scene.GetFiles("*" + Unfinished)));
                    }
                    bytes = files.Sum(file => file.Length);
                    files.Sort((a, b) => a.LastWriteTimeUtc.CompareTo(b.LastWriteTimeUtc));
                });
            return files;
        }

        private string PathOf(ulong key, Box box)
        {
            float[] sides = { box.MinX, box.MinY, box.MinZ, box.MaxX, box.MaxY, box.MaxZ };
            string digits = string.Concat(sides.Select(side => BitConverter.ToUInt32(BitConverter.GetBytes(side), 0).ToString("x8")));
            return Path.Combine(folder, key.ToString("x16") + "-" + digits + Ending);
        }

        private static bool TryParse(string name, out ulong key, out Box box)
        {
            var sides = new float[6];
            bool isOurs = name.Length == 16 + 1 + 48 + Ending.Length & TryHex(name, 0, 16, out key);
            for (int at = 0; isOurs && at < 6; at++)
            {
                isOurs = TryHex(name, 17 + 8 * at, 8, out ulong bits);
                sides[at] = BitConverter.ToSingle(BitConverter.GetBytes((uint)bits), 0);
            }
            box = new Box(sides[0], sides[1], sides[2], sides[3], sides[4], sides[5]);
            return isOurs;
        }

        private static bool TryHex(string text, int start, int count, out ulong value)
        {
            value = 0;
            return start + count <= text.Length
                && ulong.TryParse(text.Substring(start, count), NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out value);
        }

        private static bool Try(Action action)
        {
            try
            {
                action();
                return true;
            }
            catch (Exception error) when (error is IOException || error is UnauthorizedAccessException || error is NotSupportedException
                || error is ArgumentException || error is System.Security.SecurityException)
            {
                return false;
            }
        }
    }
}
