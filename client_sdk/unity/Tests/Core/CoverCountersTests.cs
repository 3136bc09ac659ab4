using System;
using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>The hide rule: a base face is hidden if and only if its list is not empty and every segment in it is shown.</summary>
    [TestFixture]
    public class CoverCountersTests
    {
        [Test]
        public void Hidden_EqualsBruteForce_InWhateverOrder()
        {
            for (uint seed = 1; seed <= 20; seed++)
            {
                var noise = new Noise(seed);
                Cover cover = Covers.Random(noise, 200, 30);
                var counters = new CoverCounters(cover);
                var shown = new HashSet<uint>();
                for (int step = 0; step < 300; step++)
                {
                    // Two ids beyond every list: they hide nothing.
                    uint segment = (uint)noise.Below(32);
                    var turned = new HashSet<int>();
                    byte[] before = (byte[])counters.Hidden.Mask.Clone();
                    if (noise.Below(2) == 0)
                    {
                        counters.Add(segment, face => Assert.IsTrue(turned.Add(face)));
                        shown.Add(segment);
                    }
                    else
                    {
                        counters.Remove(segment, face => Assert.IsTrue(turned.Add(face)));
                        shown.Remove(segment);
                    }
                    byte[] expected = Covers.Hidden(cover, shown);
                    Assert.IsTrue(Covers.IsSame(expected, counters.Hidden.Mask), "seed " + seed);
                    Assert.AreEqual(Covers.Sum(expected), counters.Hidden.Count);
                    int changes = 0;
                    for (int face = 0; face < before.Length; face++)
                    {
                        changes += before[face] == expected[face] ? 0 : turned.Contains(face) ? 1 : 1000;
                    }
                    Assert.AreEqual(turned.Count, changes, "told faces must be those that changed");
                }
            }
        }

        [Test]
        public void Hash_TellsSetsApart_AndForgetsTheOrder()
        {
            Cover cover = Covers.Random(new Noise(3), 100, 10);
            var forwards = new CoverCounters(cover);
            var backwards = new CoverCounters(cover);
            for (uint segment = 0; segment < 10; segment++)
            {
                forwards.Add(segment, null);
                backwards.Add(9 - segment, null);
            }
            Assert.AreEqual(forwards.Hidden.Hash, backwards.Hidden.Hash);
            Assert.Greater(forwards.Hidden.Count, 0);
            backwards.Remove(4, null);
            Assert.AreNotEqual(forwards.Hidden.Hash, backwards.Hidden.Hash);
        }

        [Test]
        public void Rows_ThatAreNone_AreRefused()
        {
            Assert.Throws<ArgumentException>(() => new CoverCounters(new Cover(new uint[] { 1, 1 }, new uint[] { 0 })));
            Assert.Throws<ArgumentException>(() => new CoverCounters(new Cover(new uint[] { 0, 2 }, new uint[] { 0 })));
            Assert.Throws<ArgumentException>(() => new CoverCounters(new Cover(new uint[] { 0, 2, 1, 2 }, new uint[] { 0, 1 })));
            Assert.Throws<ArgumentException>(() => new CoverCounters(new Cover(new uint[] { 0, 1 }, new[] { uint.MaxValue })));
        }
    }
}
