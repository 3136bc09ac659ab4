using System;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>XXH3-64 against digests of the reference implementation (xxHash 0.8), every branch by length.</summary>
    [TestFixture]
    public class Xxh3Tests
    {
        [TestCase(0, 0x2D06800538D394C2UL)]
        [TestCase(1, 0x429E81BC6744101CUL)]
        [TestCase(3, 0x32DBB5C7774CC94FUL)]
        [TestCase(4, 0x65775238CA34C06FUL)]
        [TestCase(8, 0x90B760C9D253D0FFUL)]
        [TestCase(9, 0x15AE9F843BB50EA4UL)]
        [TestCase(16, 0x372C92FA68129C98UL)]
        [TestCase(17, 0xB5D6B9C1898BD9D6UL)]
        [TestCase(32, 0x0AB1DBF9E9F8C22CUL)]
        [TestCase(33, 0x4F4AE280E8465C3CUL)]
        [TestCase(96, 0xE1E1BA1B4E47DED7UL)]
        [TestCase(128, 0xC59E505A97D029E0UL)]
        [TestCase(129, 0xF9E651A476D6D3CAUL)]
        [TestCase(240, 0x967597E635F3C527UL)]
        [TestCase(241, 0xD6AFAC6F8FA85B01UL)]
        [TestCase(256, 0x9E6593BAB96413DAUL)]
        [TestCase(512, 0x426B67E0356D303DUL)]
        [TestCase(1024, 0xBB9F0C3761CDFD54UL)]
        [TestCase(1025, 0x95EDCCC1ADC4D895UL)]
        [TestCase(2048, 0x278F7A6A39416B51UL)]
        [TestCase(4999, 0xEA18E5DD8FD15F51UL)]
        public void Hash_OfTheReference(int length, ulong expected)
        {
            byte[] bytes = Noise.Bytes(5000);
            Assert.AreEqual(expected, Xxh3.Hash64(bytes, 0, length));
            // The same bytes at a place that is no multiple of 8.
            var moved = new byte[length + 3];
            Buffer.BlockCopy(bytes, 0, moved, 3, length);
            Assert.AreEqual(expected, Xxh3.Hash64(moved, 3, length));
        }

        [TestCase(-1, 1)]
        [TestCase(0, -1)]
        [TestCase(0, 11)]
        [TestCase(10, 1)]
        [TestCase(int.MaxValue, int.MaxValue)]
        public void Range_OutsideTheArray_IsRefused(int offset, int length)
        {
            Assert.Throws<ArgumentOutOfRangeException>(() => Xxh3.Hash64(new byte[10], offset, length));
        }
    }
}
