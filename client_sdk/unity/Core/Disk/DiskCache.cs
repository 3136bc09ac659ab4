using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Text;
using Terraport.Sessions;

namespace Terraport.Disk
{
    /// <summary>
    /// Payloads on disk, from one run to the next, of all scenes in one folder: named by their hash, checked when they are read, written
    /// beside and renamed. Bounded in bytes; what was used longest ago goes first. Nothing here throws: a disk that is full, damaged or
    /// read-only keeps less, or nothing.
    /// </summary>
    /// <remarks>FOLDER/(16 digits: XXH3-64 of the scene's URL)/(segment)-(16 digits: XXH3-64).segment-2. Every method blocks. One thread at a time;
    /// several processes may share a folder.</remarks>
    public sealed class DiskCache
    {
        // When full, down to this part of the bound, so that not every write looks at the folder.
        private const double Room = 0.9;
        private static readonly TimeSpan Stale = TimeSpan.FromHours(1);

        private readonly string root;
        private readonly string folder;
        private readonly long maxBytes;
        // Over all scenes; -1 before the folder was looked at.
        private long bytes = -1;
        private bool isWritable = true;

        /// <summary>The cache of one scene.</summary>
        public DiskCache(string root, string sceneUrl, long maxBytes)
        {
            this.root = root;
            folder = Path.Combine(root, Xxh3.Hash64(Encoding.UTF8.GetBytes(sceneUrl)).ToString("x16"));
            this.maxBytes = maxBytes;
        }

        /// <summary>What is kept of the scene, used last first, until so many bytes or milliseconds are over. Damaged files are deleted.</summary>
        /// <param name="mostBytes">Payload bytes at most.</param>
        /// <param name="mostMs">Milliseconds at most, the file in hand excepted.</param>
        /// <param name="pool">Where the buffers come from; they are the caller's.</param>
        public List<KeyValuePair<SegmentFacts, PayloadBuffer>> Restore(long mostBytes, double mostMs, PayloadPool pool)
        {
            var restored = new List<KeyValuePair<SegmentFacts, PayloadBuffer>>();
            var segments = new HashSet<uint>();
            Stopwatch watch = Stopwatch.StartNew();
            List<FileInfo> files = Look();
            long total = 0;
            for (int at = files.Count - 1; at >= 0 && watch.Elapsed.TotalMilliseconds < mostMs; at--)
            {
                FileInfo file = files[at];
                uint segment;
                if (!IsOfScene(file) || !SegmentFile.TryParse(file.Name, out segment)) continue;
                // Of two versions of the scene: the one that was used last.
                if (!segments.Add(segment))
                {
                    Delete(file);
                    continue;
                }
                if (total + file.Length > mostBytes) break;
                PayloadBuffer payload;
                SegmentFacts facts;
                if (!TryRead(file, pool, out facts, out payload)) continue;
                restored.Add(new KeyValuePair<SegmentFacts, PayloadBuffer>(facts, payload));
                total += file.Length;
            }
            return restored;
        }

        /// <summary>Keep a payload, used just now; whether it is on disk.</summary>
        public bool Put(SegmentFacts facts, byte[] data)
        {
            long needed = SegmentFile.HeadBytes + (long)facts.Length;
            if (!isWritable || needed > maxBytes) return false;
            string path = PathOf(facts);
            string beside = Path.Combine(folder, "." + Guid.NewGuid().ToString("N") + ".tmp");
            try
            {
                if (File.Exists(path))
                {
                    File.SetLastWriteTimeUtc(path, DateTime.UtcNow);
                    return true;
                }
                if (bytes < 0) Look();
                if (bytes + needed > maxBytes) MakeRoom(needed);
                Directory.CreateDirectory(folder);
                using (FileStream file = new FileStream(beside, FileMode.CreateNew, FileAccess.Write, FileShare.None))
                {
                    file.Write(SegmentFile.Head(facts), 0, SegmentFile.HeadBytes);
                    file.Write(data, 0, facts.Length);
                }
                File.Move(beside, path);
                bytes += needed;
                return true;
            }
            catch (Exception error) when (IsOfDisk(error))
            {
                // A folder that cannot be written is not asked again: each attempt would cost as much as a write.
                isWritable = File.Exists(path);
                Try(() => File.Delete(beside));
                return isWritable;
            }
        }

        /// <summary>Note that a payload was used, so that it goes last.</summary>
        public void Use(SegmentFacts facts)
        {
            string path = PathOf(facts);
            if (isWritable) Try(() => File.SetLastWriteTimeUtc(path, DateTime.UtcNow));
        }

        private static bool IsOfDisk(Exception error)
        {
            return error is IOException || error is UnauthorizedAccessException || error is NotSupportedException
                || error is ArgumentException || error is System.Security.SecurityException;
        }

        private static bool Try(Action action)
        {
            try
            {
                action();
                return true;
            }
            catch (Exception error) when (IsOfDisk(error))
            {
                return false;
            }
        }

        private string PathOf(SegmentFacts facts) { return Path.Combine(folder, SegmentFile.NameOf(facts.Segment, facts.Xxh3)); }

        private bool IsOfScene(FileInfo file) { return file.DirectoryName == new DirectoryInfo(folder).FullName; }

        private void Delete(FileInfo file)
        {
            long length = file.Length;
            if (Try(file.Delete)) bytes -= length;
        }

        /// <summary>Whole, and what its name says; else it is deleted.</summary>
        private bool TryRead(FileInfo file, PayloadPool pool, out SegmentFacts facts, out PayloadBuffer payload)
        {
            payload = null;
            facts = default(SegmentFacts);
            SegmentFacts read = default(SegmentFacts);
            PayloadBuffer buffer = null;
            bool isWhole = false;
            bool isReadable = Try(() =>
                {
                    using (FileStream stream =
                               new FileStream(file.FullName, FileMode.Open, FileAccess.Read, FileShare.ReadWrite | FileShare.Delete))
                    {
                        var head = new byte[SegmentFile.HeadBytes];
                        if (Fill(stream, head, head.Length) && SegmentFile.TryRead(head, stream.Length, out read))
                        {
                            buffer = pool.Rent(read.Length);
                            isWhole = file.Name == SegmentFile.NameOf(read.Segment, read.Xxh3) && Fill(stream, buffer.Data, read.Length)
                                && Xxh3.Hash64(buffer.Data, 0, read.Length) == read.Xxh3;
                        }
                    }
                });
            if (isReadable && isWhole)
            {
                facts = read;
                payload = buffer;
                return true;
            }
            if (buffer != null) buffer.Release();
            if (isReadable) Delete(file);
            return false;
        }

        private static bool Fill(Stream stream, byte[] data, int length)
        {
            int at = 0;
            while (at < length)
            {
                int count = stream.Read(data, at, length - at);
                if (count == 0) return false;
                at += count;
            }
            return true;
        }

        /// <summary>Every file of all scenes, used longest ago first; counts the bytes, and deletes what a process that died left behind.</summary>
        private List<FileInfo> Look()
        {
            var files = new List<FileInfo>();
            bytes = 0;
            Try(() =>
                {
                    if (!Directory.Exists(root)) return;
                    foreach (string scene in Directory.GetDirectories(root))
                    {
                        // What is not ours stays, whoever put it there.
                        if (IsKey(Path.GetFileName(scene))) Look(scene, files);
                    }
                });
            // Read once: another process may delete any of them.
            files.RemoveAll(file => !Try(() => bytes += file.Length));
            files.Sort((a, b) => a.LastWriteTimeUtc.CompareTo(b.LastWriteTimeUtc));
            return files;
        }

        private static void Look(string scene, List<FileInfo> files)
        {
            foreach (string path in Directory.GetFiles(scene))
            {
                var file = new FileInfo(path);
                uint segment;
                bool isBeside = file.Name[0] == '.' && file.Extension == ".tmp";
                if (isBeside && DateTime.UtcNow - file.LastWriteTimeUtc > Stale)
                    Try(file.Delete);
                else if (isBeside || SegmentFile.TryParse(file.Name, out segment))
                    files.Add(file);
            }
        }

        private static bool IsKey(string name)
        {
            ulong key;
            return name.Length == 16 && ulong.TryParse(name, NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out key);
        }

        private void MakeRoom(long needed)
        {
            foreach (FileInfo file in Look())
            {
                if (bytes <= (long)(maxBytes * Room) - needed) return;
                // Another process is writing it.
                if (file.Name[0] != '.') Delete(file);
            }
        }
    }
}
