using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using NUnit.Framework;
using Terraport.Disk;
using Terraport.Sessions;

namespace Terraport.Tests
{
    /// <summary>Payloads on a real disk, from one cache to the next.</summary>
    public sealed class DiskCacheTests
    {
        private const string Url = "http://127.0.0.1:1/scenes/quarry";
        private const long Bound = 1 << 20;
        private readonly PayloadPool pool = new PayloadPool(0);
        private string folder;

        [SetUp]
        public void MakeFolder() { folder = Path.Combine(Path.GetTempPath(), "terraport-" + Guid.NewGuid().ToString("N")); }

        [TearDown]
        public void DeleteFolder()
        {
            if (Directory.Exists(folder)) Directory.Delete(folder, true);
            if (File.Exists(folder)) File.Delete(folder);
        }

        [Test]
        public void WhatWasPutIsRestoredByAnother()
        {
            SegmentFacts facts = Put(Open(), 7, 1000, 1);
            List<KeyValuePair<SegmentFacts, PayloadBuffer>> restored = Restored(Open());
            Assert.AreEqual(1, restored.Count);
            Assert.AreEqual(facts, restored[0].Key);
            CollectionAssert.AreEqual(Payload(1000, 1), restored[0].Value.Data.Take(1000));
            Assert.AreEqual(0, Restored(new DiskCache(folder, Url + "2", Bound)).Count, "another scene's");
        }

        [Test]
        public void DamagedFilesAreDropped()
        {
            DiskCache cache = Open();
            for (uint segment = 0; segment < 6; segment++) Put(cache, segment, 500, (int)segment);
            string[] files = Files();
            Damage(files[0], bytes => bytes[0] ^= 1);
            Damage(files[1], bytes => bytes[20] ^= 1);
            Damage(files[2], bytes => bytes[bytes.Length - 1] ^= 1);
            File.WriteAllBytes(files[3], File.ReadAllBytes(files[3]).Take(300).ToArray());
            File.WriteAllBytes(files[4], new byte[3]);
            Assert.AreEqual(1, Restored(Open()).Count);
            CollectionAssert.AreEqual(new[] { files[5] }, Files());
        }

        [Test]
        public void ItKeepsItsBoundAndWhatWasUsedLast()
        {
            DiskCache cache = Open(10 * 1064);
            var facts = new List<SegmentFacts>();
            for (uint segment = 0; segment < 10; segment++)
            {
                facts.Add(Put(cache, segment, 1000, (int)segment));
                Age(segment, 100 - (int)segment);
            }
            cache.Use(facts[0]);
            Put(cache, 10, 1000, 10);
            Assert.LessOrEqual(Files().Sum(path => new FileInfo(path).Length), 10 * 1064);
            CollectionAssert.IsSubsetOf(new uint[] { 0, 9, 10 }, Ids(Restored(Open())));
            CollectionAssert.DoesNotContain(Ids(Restored(Open())), 1);
            Assert.IsFalse(cache.Put(Facts(11, 20000, 11), Payload(20000, 11)), "larger than the bound");
        }

        [Test]
        public void TheNewestComeFirstUpToTheBytesThatAreAskedFor()
        {
            DiskCache cache = Open();
            for (uint segment = 0; segment < 5; segment++)
            {
                Put(cache, segment, 1000, (int)segment);
                Age(segment, 100 - (int)segment);
            }
            List<KeyValuePair<SegmentFacts, PayloadBuffer>> restored = Open().Restore(2500, 10000, pool);
            CollectionAssert.AreEqual(new uint[] { 4, 3 }, restored.Select(entry => entry.Key.Segment));
        }

        [Test]
        public void OfTwoVersionsTheNewerCounts()
        {
            DiskCache cache = Open();
            Put(cache, 3, 1000, 1);
            Age(3, 50);
            SegmentFacts newer = Put(cache, 3, 1200, 2);
            Assert.AreEqual(newer, Restored(Open()).Single().Key);
            Assert.AreEqual(1, Files().Length);
        }

        [Test]
        public void WhatIsNotOursStays()
        {
            string foreign = Path.Combine(folder, "photos", "1-0123456789abcdef.segment-2");
            Directory.CreateDirectory(Path.GetDirectoryName(foreign));
            File.WriteAllBytes(foreign, new byte[5000]);
            DiskCache cache = Open(3000);
            for (uint segment = 0; segment < 5; segment++) Put(cache, segment, 1000, (int)segment);
            Assert.IsTrue(File.Exists(foreign));
        }

        [Test]
        public void AFolderThatCannotBeWrittenIsNoError()
        {
            File.WriteAllText(folder, "a file where the folder should be");
            DiskCache cache = Open();
            Assert.AreEqual(0, Restored(cache).Count);
            Assert.IsFalse(cache.Put(Facts(1, 100, 1), Payload(100, 1)));
            cache.Use(Facts(1, 100, 1));
        }

        private static byte[] Payload(int length, int seed)
        {
            var bytes = new byte[length];
            new Random(seed).NextBytes(bytes);
            return bytes;
        }

        private static SegmentFacts Facts(uint segment, int length, int seed)
        {
            return new SegmentFacts(segment, length, Xxh3.Hash64(Payload(length, seed)), 12, 9, new Box(-1, 0, 2, 3, 4, 5));
        }

        private static uint[] Ids(List<KeyValuePair<SegmentFacts, PayloadBuffer>> restored)
        {
            return restored.Select(entry => entry.Key.Segment).ToArray();
        }

        private static void Damage(string path, Action<byte[]> damage)
        {
            byte[] bytes = File.ReadAllBytes(path);
            damage(bytes);
            File.WriteAllBytes(path, bytes);
        }

        private static SegmentFacts Put(DiskCache cache, uint segment, int length, int seed)
        {
            SegmentFacts facts = Facts(segment, length, seed);
            Assert.IsTrue(cache.Put(facts, Payload(length, seed)));
            return facts;
        }

        private DiskCache Open(long bound = Bound) { return new DiskCache(folder, Url, bound); }

        private List<KeyValuePair<SegmentFacts, PayloadBuffer>> Restored(DiskCache cache) { return cache.Restore(Bound, 10000, pool); }

        private void Age(uint segment, int seconds)
        {
            string path = Files().Single(file => Path.GetFileName(file).StartsWith(segment + "-", StringComparison.Ordinal));
            File.SetLastWriteTimeUtc(path, DateTime.UtcNow.AddSeconds(-seconds));
        }

        private string[] Files()
        {
            string[] files = Directory.GetFiles(folder, "*.segment-2", SearchOption.AllDirectories);
            Array.Sort(files, StringComparer.Ordinal);
            return files;
        }
    }
}
