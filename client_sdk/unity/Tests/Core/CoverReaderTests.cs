using System;
using System.IO;
using NUnit.Framework;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>The corpus of covers: good ones give what is written beside them, bad ones are refused.</summary>
    [TestFixture]
    public class CoverReaderTests
    {
        [Test]
        public void Corpus_IsReadAndRefused()
        {
            int good = 0;
            int bad = 0;
            foreach (string path in Directory.GetFiles(Repository.PathTo("tests/conformance/scene/cover"), "*.cover"))
            {
                string name = Path.GetFileName(path);
                JsonValue expected = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(Path.ChangeExtension(path, ".json"))));
                int baseFaces = (int)WholeOf(expected["base_faces"]);
                int segmentCount = (int)WholeOf(expected["segment_count"]);
                // In the middle of an array: the offset counts.
                byte[] bytes = File.ReadAllBytes(path);
                var larger = new byte[bytes.Length + 9];
                Buffer.BlockCopy(bytes, 0, larger, 5, bytes.Length);
                var file = new ArraySegment<byte>(larger, 5, bytes.Length);
                if (!expected["error"].IsNull)
                {
                    Assert.Throws<PayloadException>(() => CoverReader.Read(file, baseFaces, segmentCount), name);
                    bad++;
                    continue;
                }
                Cover cover = CoverReader.Read(file, baseFaces, segmentCount);
                CheckNumbers(expected["offsets"], cover.Offsets, name);
                CheckNumbers(expected["segments"], cover.Segments, name);
                if (cover.Segments.Length > 0)
                {
                    Assert.Throws<PayloadException>(() => CoverReader.Read(file, baseFaces, segmentCount - 1), name);
                }
                good++;
            }
            Assert.GreaterOrEqual(good, 9);
            Assert.GreaterOrEqual(bad, 21);
        }

        [Test]
        public void ChangedSteps_AreReadOrRefused()
        {
            byte[] whole = File.ReadAllBytes(Repository.PathTo("tests/conformance/scene/cover/good-many.cover"));
            int accepted = 0;
            for (int at = 32; at < whole.Length; at++)
            {
                for (int bit = 0; bit < 8; bit++)
                {
                    var changed = (byte[])whole.Clone();
                    changed[at] ^= (byte)(1 << bit);
                    Seal(changed);
                    try
                    {
                        Cover cover = CoverReader.Read(new ArraySegment<byte>(changed), 12, 4096);
                        Assert.AreEqual(13, cover.Offsets.Length);
                        Assert.AreEqual((uint)cover.Segments.Length, cover.Offsets[12]);
                        accepted++;
                    }
                    catch (PayloadException)
                    {
                    }
                }
            }
            Assert.Greater(accepted, 10);
        }

        private static void Seal(byte[] file) { BitConverter.GetBytes(Xxh3.Hash64(file, 16, file.Length - 16)).CopyTo(file, 8); }

        private static void CheckNumbers(JsonValue expected, uint[] actual, string name)
        {
            Assert.AreEqual(expected.Count, actual.Length, name);
            for (int at = 0; at < actual.Length; at++)
            {
                Assert.AreEqual(WholeOf(expected[at]), actual[at], name);
            }
        }

        private static long WholeOf(JsonValue value)
        {
            long number;
            Assert.IsTrue(value.TryInteger(out number));
            return number;
        }
    }
}
